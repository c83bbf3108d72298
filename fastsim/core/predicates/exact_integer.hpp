#pragma once
// Signed integers of any size that a geometric predicate can need, on the stack.
//
// A double is an integer times a power of two. Brought to one common exponent, coordinates become
// integers, and a determinant of them is exact whatever their size: nothing overflows, nothing
// underflows. Only reached when the floating-point filter cannot tell.

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace fastsim {

class ExactInteger {
  public:
    // Doubles span 2^-1074 to 2^1024: 33 limbs. A determinant of degree 5 needs 5 times that.
    static constexpr std::size_t capacity = 176;

    ExactInteger() = default;
    ExactInteger(const ExactInteger &other) { *this = other; }
    ExactInteger &operator=(const ExactInteger &other) {
        _size = other._size;
        _is_negative = other._is_negative;
        std::copy_n(other._limbs.begin(), _size, _limbs.begin());
        return *this;
    }

    /// value * 2^-exponent, which must be a whole number.
    static ExactInteger from_double(double value, int exponent) {
        ExactInteger result;
        if (value == 0.0)
            return result;
        int own = 0;
        const double fraction = std::frexp(std::abs(value), &own); // in [0.5, 1)
        auto mantissa = static_cast<std::uint64_t>(std::ldexp(fraction, 53));
        int shift = own - 53 - exponent;
        if (shift < 0) { // trailing zeros of the mantissa make up for it
            mantissa >>= -shift;
            shift = 0;
        }
        const auto limb = static_cast<std::size_t>(shift) / 64;
        const auto bits = static_cast<unsigned>(shift) % 64;
        std::fill_n(result._limbs.begin(), limb + 2, std::uint64_t{0});
        result._limbs[limb] = mantissa << bits;
        result._limbs[limb + 1] = bits == 0 ? 0 : mantissa >> (64 - bits);
        result._size = limb + 2;
        result.trim();
        result._is_negative = value < 0.0;
        return result;
    }

    /// Exponent of the last set bit of a value that is not zero.
    static int lowest_exponent(double value) {
        int own = 0;
        const double fraction = std::frexp(std::abs(value), &own);
        const auto mantissa = static_cast<std::uint64_t>(std::ldexp(fraction, 53));
        return own - 53 + std::countr_zero(mantissa);
    }

    int sign() const { return _size == 0 ? 0 : (_is_negative ? -1 : 1); }

    friend ExactInteger operator+(const ExactInteger &a, const ExactInteger &b) {
        if (a._is_negative == b._is_negative)
            return add_magnitudes(a, b, a._is_negative);
        const int order = compare_magnitudes(a, b);
        if (order == 0)
            return {};
        return order > 0 ? subtract_magnitudes(a, b, a._is_negative)
                         : subtract_magnitudes(b, a, b._is_negative);
    }

    friend ExactInteger operator-(const ExactInteger &a, const ExactInteger &b) {
        ExactInteger negated = b;
        negated._is_negative = !b._is_negative;
        return a + negated;
    }

    friend ExactInteger operator*(const ExactInteger &a, const ExactInteger &b) {
        ExactInteger product;
        if (a._size == 0 || b._size == 0)
            return product;
        product._size = a._size + b._size;
        std::fill_n(product._limbs.begin(), product._size, std::uint64_t{0});
        for (std::size_t i = 0; i < a._size; ++i) {
            std::uint64_t carry = 0;
            for (std::size_t j = 0; j < b._size; ++j) {
                const Wide sum = Wide{a._limbs[i]} * b._limbs[j] + product._limbs[i + j] + carry;
                product._limbs[i + j] = static_cast<std::uint64_t>(sum);
                carry = static_cast<std::uint64_t>(sum >> 64);
            }
            product._limbs[i + b._size] = carry;
        }
        product.trim();
        product._is_negative = a._is_negative != b._is_negative;
        return product;
    }

  private:
    __extension__ using Wide = unsigned __int128;

    static int compare_magnitudes(const ExactInteger &a, const ExactInteger &b) {
        if (a._size != b._size)
            return a._size > b._size ? 1 : -1;
        for (std::size_t i = a._size; i-- > 0;)
            if (a._limbs[i] != b._limbs[i])
                return a._limbs[i] > b._limbs[i] ? 1 : -1;
        return 0;
    }

    static ExactInteger add_magnitudes(const ExactInteger &a, const ExactInteger &b,
                                       bool is_negative) {
        ExactInteger sum;
        const std::size_t size = std::max(a._size, b._size);
        Wide carry = 0;
        for (std::size_t i = 0; i < size; ++i) {
            carry += a.limb(i);
            carry += b.limb(i);
            sum._limbs[i] = static_cast<std::uint64_t>(carry);
            carry >>= 64;
        }
        sum._limbs[size] = static_cast<std::uint64_t>(carry);
        sum._size = size + 1;
        sum.trim();
        sum._is_negative = is_negative;
        return sum;
    }

    /// |a| - |b| with |a| >= |b|.
    static ExactInteger subtract_magnitudes(const ExactInteger &a, const ExactInteger &b,
                                            bool is_negative) {
        ExactInteger difference;
        std::uint64_t borrow = 0;
        for (std::size_t i = 0; i < a._size; ++i) {
            const Wide taken = Wide{b.limb(i)} + borrow;
            borrow = Wide{a._limbs[i]} < taken ? 1 : 0;
            difference._limbs[i] = static_cast<std::uint64_t>(Wide{a._limbs[i]} - taken);
        }
        difference._size = a._size;
        difference.trim();
        difference._is_negative = is_negative;
        return difference;
    }

    std::uint64_t limb(std::size_t i) const { return i < _size ? _limbs[i] : 0; }

    void trim() {
        while (_size > 0 && _limbs[_size - 1] == 0)
            --_size;
    }

    std::size_t _size = 0;
    bool _is_negative = false;
    std::array<std::uint64_t, capacity> _limbs; // only the first _size are set
};

} // namespace fastsim
