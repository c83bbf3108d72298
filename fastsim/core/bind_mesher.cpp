// Bindings of the mesher part of the core: no logic, no defaults.
#include <nanobind/nanobind.h>

namespace nb = nanobind;

void bind_mesher(nb::module_ &module);

void bind_mesher(nb::module_ &) {}
