#!/usr/bin/env bash
# Builds the core under sanitizers, beside the ordinary build, and runs the tests of fastsim on it:
#   bash .ci/sanitize.sh PYTHON [pytest arguments]
# SANITIZE=address,undefined chooses which. The first finding ends the run. With FUZZ_SECONDS set,
# mutated surfaces are meshed for so long instead, from FUZZ_SEED on.
set -euo pipefail
cd "$(dirname "$0")/.."
python="$(command -v "${1:-python3}")"
shift || true
sanitizers="${SANITIZE:-address,undefined}"
PATH="$(dirname "$("$python" -c 'import sys; print(sys.executable)')"):$PATH"

# The rooms as in .ci/view.sh; fastsim file by file, so that it can have another _core.
view=build/view-sanitize/palpate
mkdir -p "$view/fastsim"
for room in meshes reference validation; do ln -sfn "../../../$room" "$view/$room"; done
find "$view/fastsim" -type l -delete
for file in fastsim/*.py fastsim/*.pyi fastsim/py.typed fastsim/*/; do
    case "$file" in fastsim/core/ | fastsim/__pycache__/) continue ;; esac
    ln -sfn "../../../../${file%/}" "$view/fastsim/$(basename "$file")"
done
sed 's/${version}/dev/' validation/front_door.py.in >"$view/__init__.py"

tag=$("$python" -c 'import sys; print(sys.implementation.cache_tag)')
cmake -S fastsim/core -B "build/core-sanitize-$tag" -G Ninja -DPython_EXECUTABLE="$python" \
    -DCMAKE_BUILD_TYPE=RelWithDebInfo -DFASTSIM_SANITIZE="$sanitizers" \
    -DCMAKE_LIBRARY_OUTPUT_DIRECTORY="$PWD/$view/fastsim" >"build/cmake-sanitize-$tag.log"
cmake --build "build/core-sanitize-$tag" ${CMAKE_BUILD_ARGS:-}

# Python itself is not built with them, so their libraries must come first; it leaks on purpose.
compiler="${CXX:-c++}"
preload=""
for library in libasan.so libubsan.so; do
    preload="$preload $("$compiler" -print-file-name="$library")"
done
under=(env "LD_PRELOAD=${preload# }" ASAN_OPTIONS=detect_leaks=0 UBSAN_OPTIONS=print_stacktrace=1
    PYTHONPATH=build/view-sanitize "$python")
if [ -n "${FUZZ_SECONDS:-}" ]; then
    "${under[@]}" tests/fuzz_surfaces.py --seconds "$FUZZ_SECONDS" --seed "${FUZZ_SEED:-0}"
    exit
fi
# dolfinx brings an MPI that the sanitizers do not like; nightly tests have limits of time that a
# build for sanitizers does not meet.
# A finding ends the process at once: what it prints would be lost in what pytest has captured.
"${under[@]}" -m pytest -q --capture=sys -p no:cacheprovider \
    -m "not dolfinx and not slow and not nightly" --ignore=tests/fastsim/gpu --timeout 1200 "${@:-tests/fastsim}"
