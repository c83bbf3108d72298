#!/usr/bin/env bash
# Makes the virtual environment and installs palpate into it. Quick when nothing changed.
#
#   FENICSX=apt     Debian's python3-dolfinx; the environment sees the system's packages
#   FENICSX=wheel   the PyPI wheel dolfinx-solver-real; Python >= 3.12, no root needed
#   FENICSX=none    everything but the reference
#   (unset)         apt where it has python3-dolfinx and may be used, else wheel, else none
#   PYTHON=...      the interpreter to use where the route leaves a choice
#   VENV=...        where the environment goes (.venv)
#   PALPATE_WERROR=1  warnings of the core's compiler are errors
set -euo pipefail
cd "$(dirname "$0")/.."

VENV="${VENV:-.venv}"
WANTED="${FENICSX:-}"
STATE="$VENV/.palpate"
LOG="build/setup-$(basename "$VENV").log"
mkdir -p build

say() { printf 'setup: %s\n' "$*"; }
die() {
    printf 'setup: %s\n' "$*" >&2
    exit 2
}
logged() { # run quietly; show the end of what it said only when it fails
    "$@" >>"$LOG" 2>&1 || {
        tail -n 25 "$LOG" >&2
        die "failed: $* (all of it in $LOG)"
    }
}

case "$WANTED" in
"" | apt | wheel | none) ;;
*) die "FENICSX=$WANTED is not known; use apt, wheel or none" ;;
esac

# ------------------------------------------------------------------ what is possible here
APT_PACKAGES="python3-dolfinx python3-venv python3-dev python3-h5py libopenblas0-pthread g++ \
libegl1 libgl1 libglu1-mesa libxrender1 libxcursor1 libxft2 libxinerama1 libgomp1"

apt_get() { # as root; another set-up may be at it
    local root=""
    [ "$(id -u)" = 0 ] || root="sudo -n"
    $root env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=900 "$@"
}
apt_missing() {
    local name
    for name in $APT_PACKAGES; do
        case "$(dpkg-query -W -f='${Status}' "$name" 2>/dev/null)" in
        *"ok installed") ;;
        *) echo "$name" ;;
        esac
    done
}
apt_offers_dolfinx() { # no pipe: `grep -q` would end apt-cache early, an error under pipefail
    case "$(apt-cache policy python3-dolfinx 2>/dev/null)" in
    *"Candidate: "[0-9]*) return 0 ;;
    *) return 1 ;;
    esac
}
may_install() {
    [ "$(id -u)" = 0 ] || sudo -n true 2>/dev/null
}
apt_possible() { # sets APT_WHY when not
    APT_WHY=""
    if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
        APT_WHY="this system has no apt"
        return 1
    fi
    if [ ! -x /usr/bin/python3 ] ||
        ! /usr/bin/python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        APT_WHY="the system's Python is older than 3.11"
        return 1
    fi
    # Everything there already: no rights are needed.
    [ -z "$(apt_missing)" ] && return 0
    if ! may_install; then
        APT_WHY="no rights to install (needs root or sudo): $(apt_missing | tr '\n' ' ')"
        return 1
    fi
    if ! apt_offers_dolfinx; then
        say "refreshing apt's package lists"
        apt_get update >>"$LOG" 2>&1 || true
        if ! apt_offers_dolfinx; then
            APT_WHY="apt has no python3-dolfinx here"
            return 1
        fi
    fi
}
is_at_least() { # is_at_least PYTHON MINOR
    "$1" -c "import sys; sys.exit(not ((3, $2) <= sys.version_info[:2] <= (3, 14)))" 2>/dev/null
}
find_python() { # find_python MINOR: the interpreter asked for, else the first on the machine
    local candidate
    if [ -n "${PYTHON:-}" ]; then
        is_at_least "$PYTHON" "$1" && command -v "$PYTHON"
        return
    fi
    for candidate in python3.13 python3.12 python3.14 python3.11 python3 \
        "${PYENV_ROOT:-$HOME/.pyenv}"/versions/3.1[1-4]*/bin/python3 /usr/bin/python3; do
        if command -v "$candidate" >/dev/null 2>&1 && is_at_least "$candidate" "$1"; then
            command -v "$candidate"
            return
        fi
    done
    return 1
}

# ------------------------------------------------------------------ choose the route
ROUTE=none
BASE_PYTHON=""
choose_apt() { apt_possible && ROUTE=apt && BASE_PYTHON=/usr/bin/python3; }
choose_wheel() { BASE_PYTHON="$(find_python 12)" && ROUTE=wheel; }
case "$WANTED" in
apt) choose_apt || say "no FEniCSx by apt: $APT_WHY; going on without the reference (remedy: install python3-dolfinx, or FENICSX=wheel with Python >= 3.12)" ;;
wheel) choose_wheel || say "no FEniCSx by wheel: it needs Python 3.12 to 3.14 and none was found; going on without the reference (remedy: install one, or FENICSX=apt as root)" ;;
"") choose_apt || choose_wheel || say "no FEniCSx: $APT_WHY, and no Python 3.12 to 3.14 for the wheel; going on without the reference (remedy: one of the two)" ;;
esac
if [ "$ROUTE" = none ]; then
    BASE_PYTHON="$(find_python 11)" || die "needs Python 3.11 to 3.14; install one or set PYTHON=/path/to/python3"
fi

# ------------------------------------------------------------------ is there anything to do?
environment_key() {
    {
        echo "$ROUTE $BASE_PYTHON"
        "$BASE_PYTHON" -c 'import sys; print(sys.version)'
        cat .ci/setup.sh pyproject.toml
    } | sha256sum | cut -d' ' -f1
}
source_key() {
    find pyproject.toml README.md LICENSE meshes fastsim reference validation -type f \
        ! -name '*.pyc' ! -name '_core*.so' -print0 | LC_ALL=C sort -z | xargs -0 sha256sum | sha256sum | cut -d' ' -f1
}
recorded() { [ -f "$STATE-$1" ] && [ "$(cat "$STATE-$1")" = "$2" ]; }

ENVIRONMENT="$(environment_key)"
SOURCES="$(source_key)"
if recorded environment "$ENVIRONMENT" && recorded sources "$SOURCES"; then
    say "$VENV is up to date (FEniCSx: $ROUTE)"
    exit 0
fi
: >"$LOG"

# ------------------------------------------------------------------ the environment
if ! recorded environment "$ENVIRONMENT"; then
    rm -f "$STATE-environment" "$STATE-sources"
    if [ "$ROUTE" = apt ]; then
        missing="$(apt_missing | tr '\n' ' ')"
        if [ -n "$missing" ]; then
            say "installing by apt (a few minutes, about 1.5 GB): $missing"
            apt_get update >>"$LOG" 2>&1 || true
            # shellcheck disable=SC2086
            logged apt_get install -y --no-install-recommends $missing
        fi
        # Only tests want these: another code on the same mesh, and more than one rank.
        for extra in calculix-ccx:ccx openmpi-bin:mpirun; do
            if ! command -v "${extra#*:}" >/dev/null && may_install; then
                apt_get install -y --no-install-recommends "${extra%:*}" >>"$LOG" 2>&1 ||
                    say "${extra%:*} could not be installed; its tests are skipped"
            fi
        done
    else
        # A compiler (for the core, and for FEniCSx's forms), headers, and venv itself.
        wanted=""
        command -v c++ >/dev/null || wanted="g++"
        "$BASE_PYTHON" -c 'import ensurepip' 2>/dev/null || wanted="$wanted python3-venv"
        "$BASE_PYTHON" -c 'import os, sys, sysconfig
sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' ||
            wanted="$wanted python3-dev"
        if [ -n "$wanted" ]; then
            if command -v apt-get >/dev/null && may_install; then
                say "installing by apt: $wanted"
                apt_get update >>"$LOG" 2>&1 || true
                # shellcheck disable=SC2086
                logged apt_get install -y --no-install-recommends $wanted
            else
                die "needed to build the simulator's core, and not here: $wanted (remedy: install them)"
            fi
        fi
    fi
    say "making $VENV with $("$BASE_PYTHON" --version) ($BASE_PYTHON), FEniCSx: $ROUTE"
    if [ "$ROUTE" = apt ]; then
        logged "$BASE_PYTHON" -m venv --clear --system-site-packages "$VENV"
    else
        logged "$BASE_PYTHON" -m venv --clear "$VENV"
    fi
fi

# Debian's dolfinx was compiled against numpy 1: a newer one breaks its import.
: >"$VENV/constraints.txt"
if [ "$ROUTE" = apt ]; then echo 'numpy<2' >"$VENV/constraints.txt"; fi
pip_install() {
    logged "$VENV/bin/python" -m pip install --disable-pip-version-check --no-input -c "$VENV/constraints.txt" "$@"
}

if ! recorded environment "$ENVIRONMENT"; then
    say "installing Python packages"
    pip_install --upgrade 'pip>=25.1'
    # --ignore-installed: what palpate needs lives in the environment, whatever the system has.
    if [ "$ROUTE" = apt ]; then pip_install --ignore-installed 'numpy<2' meshio; fi
    if [ "$ROUTE" = wheel ]; then pip_install dolfinx-solver-real; fi
    pip_install meshio 'scipy>=1.10' 'pydantic>=2.7' 'typer>=0.12' rich jinja2 matplotlib --group test --group lint
    # Optional: the independent mesher and the pictures. Nothing else depends on them.
    for extra in gmsh pyvista; do
        "$VENV/bin/python" -m pip install --disable-pip-version-check --no-input \
            -c "$VENV/constraints.txt" "$extra" >>"$LOG" 2>&1 ||
            say "$extra could not be installed; going on without it"
    done
    echo "$ENVIRONMENT" >"$STATE-environment"
fi

say "building the C++ core and installing palpate"
# By the build tools of this environment: what was compiled stays good for the next build.
werror=()
[ -z "${PALPATE_WERROR:-}" ] || werror=(--config-settings=cmake.define.PALPATE_WERROR=ON)
pip_install --no-build-isolation "${werror[@]}" .
if [ "$ROUTE" != none ]; then
    "$VENV/bin/python" -c '
import importlib.util
if importlib.util.find_spec("dolfinx_solver"):
    import dolfinx_solver
import dolfinx
print("setup: dolfinx", dolfinx.__version__)' || die "dolfinx does not import; see $LOG, or use FENICSX=none"
fi
echo "$ROUTE" >"$STATE-fenicsx"
echo "$SOURCES" >"$STATE-sources"
say "done: $VENV/bin/palpate (FEniCSx: $ROUTE)"
