// Bindings of the mechanics part of the core: no logic, no defaults.
#include <nanobind/nanobind.h>

namespace nb = nanobind;

void bind_mechanics(nb::module_ &module);

void bind_mechanics(nb::module_ &) {}
