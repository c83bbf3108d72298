# Sourced by run and nightly: stages one after another or beside one another, and their summary.
# All that a run starts carries its mark in the environment, and has its temporary files in one
# folder: processes that are left behind are found, and all of it goes away with the run.
PALPATE_CI_RUN="$$-$(date +%s)"
TMPDIR="$(mktemp -d "${TMPDIR:-/tmp}/ci-XXXXXX")"
export CI=true PALPATE_CI_RUN TMPDIR
unset PYTHONDONTWRITEBYTECODE # each run of pytest would compile every test and palpate anew: 10 s
logs="$(mktemp -d)"
checkout="$(git status --porcelain 2>/dev/null)"
summary=()
failed=0
cores="$(env -u OMP_NUM_THREADS nproc)" # which nproc takes for an order
patience=10 # with what still ends by itself [s]
declare -A running=() begun=()

end_all() { # however the run ends
    local process
    for process in "${!running[@]}"; do kill -- "-$process" 2>/dev/null; done
    for process in $(marked); do kill "$process" 2>/dev/null; done
    rm -rf "$TMPDIR"
}
trap end_all EXIT
trap 'exit 130' INT
trap 'exit 143' TERM HUP

outcome() { # outcome NAME CODE SECONDS
    if [ "$2" = 0 ]; then
        summary+=("ok      $1 ($3 s)")
    else
        summary+=("FAILED  $1 (exit $2, $3 s)")
        failed=$((failed + 1))
    fi
}

stage() { # stage NAME COMMAND...: now, on the screen
    local name="$1" start=$SECONDS code=0
    shift
    printf '\n=== %s\n' "$name"
    "$@" || code=$?
    outcome "$name" "$code" "$((SECONDS - start))"
}

# beside NAME COMMAND...: in the background as soon as a core is free; what it says is shown when
# it has ended. Begin with the longest.
beside() {
    local name="$1"
    shift
    while [ "${#running[@]}" -ge "$cores" ]; do next_end; done
    echo "... begun: $name"
    set -m # a process group of its own, which end_all ends with all that it started
    (
        code=0
        "$@" || code=$?
        echo "$code" >"$logs/$name.code"
    ) >"$logs/$name" 2>&1 </dev/null &
    set +m
    running[$!]="$name"
    begun[$name]=$SECONDS
}
next_end() { # not by `wait -n`, which forgets one of two that end together
    local process name code lives
    while :; do
        for process in "${!running[@]}"; do
            name="${running[$process]}" lives=""
            kill -0 "$process" 2>/dev/null && lives=1
            if [ -s "$logs/$name.code" ]; then
                code="$(cat "$logs/$name.code")"
            elif [ -z "$lives" ]; then
                code=137 # killed
            else
                continue
            fi
            unset "running[$process]"
            printf '\n=== %s\n' "$name"
            cat "$logs/$name"
            outcome "$name" "$code" "$((SECONDS - begun[$name]))"
            return
        done
        sleep 0.2
    done
}
end_of_all() { # wait for what runs beside
    while [ "${#running[@]}" -gt 0 ]; do next_end; done
}
not_run() { summary+=("not run $1: $2"); }

# What pytest itself calls a failure when no test was chosen, tests/conftest.py does when all were
# skipped.
tests_in() { # tests_in VENV ARGS...
    local venv="$1"
    shift
    "$venv/bin/python" -m pytest -q --durations=10 "$@"
}

install_browser() { # Debian's Chromium with its driver, and Firefox on a screen in memory
    command -v chromium >/dev/null && command -v chromedriver >/dev/null &&
        command -v firefox-esr >/dev/null && command -v Xvfb >/dev/null && return 0
    local root=""
    [ "$(id -u)" = 0 ] || root="sudo -n"
    $root apt-get update >/dev/null &&
        DEBIAN_FRONTEND=noninteractive $root apt-get install -y --no-install-recommends \
            chromium chromium-driver firefox-esr xvfb libgl1-mesa-dri libegl1 >/dev/null
}
# A fresh machine becomes a working one by the same command that users type. What the documentation
# and the browser's tests want comes with it: later, tests run beside.
set_up() {
    make setup && install_browser && .venv/bin/python -m pip install -q \
        --disable-pip-version-check -c .venv/constraints.txt --group docs --group browser || return
    echo "FEniCSx here: $(cat .venv/.palpate-fenicsx)"
    [ "$(cat .venv/.palpate-fenicsx)" != none ] # without it every test of the reference is skipped
}

marked() { # processes that this run has started, and that still live
    local file all=(/proc/[0-9]*/environ) # before grep, which carries the mark too
    grep -lzF "PALPATE_CI_RUN=$PALPATE_CI_RUN" "${all[@]}" 2>/dev/null | while read -r file; do
        file="${file%/environ}"
        case "$(sed 's/.*) //' "$file/stat" 2>/dev/null)" in
        "" | Z*) ;; # gone, or a zombie
        *) echo "${file#/proc/}" ;;
        esac
    done
}
nothing_is_left() { # no process, and a checkout as it was; temporary files go in any case
    local code=0 process left
    for ((; patience > 0; patience--)); do # a browser takes a moment to go
        [ -n "$(marked)" ] || break
        sleep 1
    done
    for process in $(marked); do
        echo "process $process is left: $(tr '\0' ' ' 2>/dev/null <"/proc/$process/cmdline")"
        code=1
    done
    left="$(git status --porcelain 2>/dev/null)"
    if [ "$left" != "$checkout" ]; then
        echo "the checkout is not as it was:"
        echo "$left"
        code=1
    fi
    return "$code"
}
end_of_run() { # the last stage, and the summary
    stage "nothing is left behind" nothing_is_left
    printf '\n=== summary\n'
    printf '%s\n' "${summary[@]}"
    local line skipped=0
    for line in "${summary[@]}"; do case "$line" in "not run"*) skipped=$((skipped + 1)) ;; esac done
    echo "$((${#summary[@]} - failed - skipped)) passed, $failed failed, $skipped not run"
    exit "$((failed > 0))"
}
