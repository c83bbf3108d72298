#pragma once
// Elements in classes of size, a factor of two apart, each of which has voxels to its measure: the
// paper's adaptive voxel size (section IV), and several of them where a mesh is graded.

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

struct SizeClasses {
    std::vector<std::uint8_t> of; // class of each element
    std::vector<double> mean;     // size of the elements of a class, > 0; the coarsest comes first

    [[nodiscard]] std::size_t count() const { return mean.size(); }
};

// Pre-condition: sizes finite, >= 0. An element of no size joins the coarsest.
SizeClasses sort_by_size(std::span<const double> sizes);

} // namespace fastsim
