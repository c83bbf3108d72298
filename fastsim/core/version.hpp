#pragma once

namespace fastsim {

/// Version of the package this core was built for; "dev" in a build of the sources in place.
const char *version();

} // namespace fastsim
