#!/usr/bin/env bash
# Links the rooms under build/view/palpate and builds the core in place, for work on the sources:
#   bash .ci/view.sh PYTHON [cmake options]; then PYTHONPATH=build/view PYTHON -m pytest
#   bash .ci/view.sh --links      the links alone, which is what mypy reads
set -euo pipefail
cd "$(dirname "$0")/.."
python="${1:-python3}"
shift || true
view=build/view/palpate
mkdir -p "$view"
for room in meshes fastsim reference validation; do
    ln -sfn "../../../$room" "$view/$room"
done
sed 's/${version}/dev/' validation/front_door.py.in >"$view/__init__.py"
[ "$python" != --links ] || exit 0
tag=$("$python" -c 'import sys; print(sys.implementation.cache_tag)')
PATH="$(dirname "$("$python" -c 'import sys; print(sys.executable)')"):$PATH"
cmake -S fastsim/core -B "build/core-$tag" -G Ninja -DPython_EXECUTABLE="$(command -v "$python")" \
    -DCMAKE_LIBRARY_OUTPUT_DIRECTORY="$PWD/fastsim" "$@" >"build/cmake-$tag.log" || {
    cat "build/cmake-$tag.log"
    exit 1
}
cmake --build "build/core-$tag"
