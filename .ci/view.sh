#!/usr/bin/env bash
# Links the rooms under build/view/palpate and the core beside them, for work on the sources:
#   bash .ci/view.sh PYTHON       then PYTHONPATH=build/view PYTHON -m pytest
#   bash .ci/view.sh --links      the links alone, which is what mypy reads
# The core is the one that the set-up compiled, brought up to date: only what changed is compiled.
set -euo pipefail
cd "$(dirname "$0")/.."
python="${1:-python3}"
view=build/view/palpate
mkdir -p "$view"
for room in meshes fastsim reference validation; do
    ln -sfn "../../../$room" "$view/$room"
done
sed 's/${version}/dev/' validation/front_door.py.in >"$view/__init__.py"
[ "$python" != --links ] || exit 0
PATH="$(dirname "$("$python" -c 'import sys; print(sys.executable)')"):$PATH"
# The folder that pyproject.toml's build-dir names for this Python.
folder=build/$("$python" -c '
import sys, sysconfig
interface = "cp311-cp311" if sys.version_info < (3, 12) else "cp312-abi3"
print(interface, sysconfig.get_platform().replace("-", "_").replace(".", "_"), sep="-")')
if [ ! -f "$folder/build.ninja" ]; then
    cmake -S fastsim/core -B "$folder" -G Ninja -DCMAKE_BUILD_TYPE=Release \
        -DPython_EXECUTABLE="$(command -v "$python")"
fi
cmake --build "$folder"
for core in "$folder"/_core*.so; do
    ln -sf "../$core" fastsim/
done
