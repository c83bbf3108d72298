#include "version.hpp"

namespace fastsim {

const char *version() { return PALPATE_VERSION; }

} // namespace fastsim
