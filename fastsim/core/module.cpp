// The compiled module: lists the bindings and the errors, holds nothing else.
#include "errors.hpp"
#include "version.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/stl/vector.h>

namespace nb = nanobind;

void bind_mesher(nb::module_ &module);
void bind_surface(nb::module_ &module);
void bind_collision(nb::module_ &module);
void bind_grading(nb::module_ &module);
void bind_mechanics(nb::module_ &module);
void bind_contact(nb::module_ &module);
void bind_explicit_run(nb::module_ &module);
void bind_condensed(nb::module_ &module);

namespace {

/// Raises a class of Python with what it carries.
template <typename... Data> void raise(const char *room, const char *name, Data &&...data) {
    const nb::object type = nb::module_::import_(room).attr(name);
    PyErr_SetObject(type.ptr(), type(std::forward<Data>(data)...).ptr());
}

void translate(const std::exception_ptr &thrown, void *) {
    try {
        std::rethrow_exception(thrown);
    } catch (const fastsim::NonFiniteError &error) {
        raise("palpate.meshes.errors", "NonFiniteError", error.points);
    } catch (const fastsim::CrowdedPointError &error) {
        raise("palpate.fastsim.errors", "CrowdedPointError", error.point);
    }
}

} // namespace

NB_MODULE(_core, module) {
    module.doc() = "Compiled core of palpate.fastsim.";
    module.attr("__version__") = fastsim::version();
    nb::register_exception_translator(translate);
    bind_mesher(module);
    bind_surface(module);
    bind_collision(module);
    bind_grading(module);
    bind_mechanics(module);
    bind_contact(module);
    bind_explicit_run(module);
    bind_condensed(module);
}
