# shellcheck shell=bash
# Says on stderr what is being done and how long it took; on a terminal the running step shows its time and its last line.

say() {
    if [[ -t 2 ]]; then printf '\r\033[K' >&2; fi # another step may be drawing its line
    printf 'env: %s\n' "$*" >&2
}

# Follows a step's output: writes all of it to the log, and redraws one line on a terminal (a line every 30 s elsewhere).
follow() { # TITLE LOG
    local title=$1 log=$2 line="" last="" status width beat=$SECONDS start=$SECONDS
    width=$( { [[ -t 2 ]] && tput cols; } 2>/dev/null || echo 100)
    : >"$log"
    while true; do
        status=0
        IFS= read -r -t 1 line || status=$?
        if ((status == 0)); then
            printf '%s\n' "$line" >>"$log"
            line=${line#"${line%%[![:space:]]*}"}
            [[ $line == @("Requirement already satisfied"*|"Using cached"*|WARNING*|"") ]] || last=$line
        elif ((status <= 128)); then
            break
        fi
        if [[ -t 2 ]]; then
            line="env:   $title, $((SECONDS - start)) s: $last"
            printf '\r\033[K%s' "${line:0:width-1}" >&2
        elif ((SECONDS - beat >= 30)); then
            beat=$SECONDS
            line="env:   $title, $((SECONDS - start)) s: $last"
            printf '%s\n' "${line:0:width}" >&2
        fi
    done
    if [[ -n $line ]]; then printf '%s\n' "$line" >>"$log"; fi
}

# Runs a command as a step; where it fails, the end of its output is shown and its exit status returned.
run_step() { # TITLE LOG COMMAND...
    local title=$1 log=$2 start=$SECONDS status=0
    shift 2
    if [[ ! -t 2 ]]; then say "  $title ..."; fi
    "$@" 2>&1 </dev/null | follow "$title" "$log" || status=$?
    if ((status > 128)); then
        say "  $title: interrupted; the same command takes it up again"
        return "$status"
    elif ((status)); then
        tail -n 25 "$log" >&2
        say "  $title: failed; the whole output is in $log"
        return "$status"
    fi
    say "  $title: $((SECONDS - start)) s"
}
