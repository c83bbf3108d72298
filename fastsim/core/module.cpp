// The compiled module: lists the bindings, holds nothing else.
#include "version.hpp"

#include <nanobind/nanobind.h>

namespace nb = nanobind;

void bind_mesher(nb::module_ &module);
void bind_surface(nb::module_ &module);
void bind_collision(nb::module_ &module);
void bind_grading(nb::module_ &module);
void bind_mechanics(nb::module_ &module);
void bind_contact(nb::module_ &module);
void bind_explicit_run(nb::module_ &module);

NB_MODULE(_core, module) {
    module.doc() = "Compiled core of palpate.fastsim.";
    module.attr("__version__") = fastsim::version();
    bind_mesher(module);
    bind_surface(module);
    bind_collision(module);
    bind_grading(module);
    bind_mechanics(module);
    bind_contact(module);
    bind_explicit_run(module);
}
