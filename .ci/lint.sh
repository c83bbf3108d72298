#!/usr/bin/env bash
# Format, style and types: ruff, clang-format, mypy --strict. The set-up compiles; with
# PALPATE_WERROR=1, as in .ci/run, warnings of the compiler are errors there.
set -euo pipefail
cd "$(dirname "$0")/.."
bin="${VENV:-.venv}/bin"
"$bin/ruff" check .
"$bin/ruff" format --check .
git ls-files '*.cpp' '*.hpp' | xargs "$bin/clang-format" --dry-run -Werror
bash .ci/view.sh --links
MYPYPATH=build/view:validation/documentation "$bin/mypy" -p palpate -p making
