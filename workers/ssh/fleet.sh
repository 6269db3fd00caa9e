#!/usr/bin/env bash
# Starts, lists and stops workers on machines with a shared folder and ssh access without a password.
#
#     fleet.sh start HOSTS RUN QUEUE_ENV [ARGUMENT...]    start one worker per host, unless it is running
#     fleet.sh list  HOSTS RUN                            list the hosts with a running worker
#     fleet.sh stop  HOSTS RUN                            SIGTERM: each worker requeues its tasks and exits
#
# HOSTS: a file with one host per line (as for ssh); # starts a comment. RUN: the run's folder, the same path on every
# host. QUEUE_ENV: keys/worker/queue.env, in the shared folder. ARGUMENTs go to `glasshouse work`: -j 8 --lease-s 30. If
# the hosts' PATH does not have `glasshouse`, set its path: GLASSHOUSE=/shared/bin/glasshouse. Each worker appends its
# output to RUN/logs/HOST.log. SSH: another ssh command.
set -euo pipefail

usage() {
    sed -n '2,/^set /s/^# \{0,1\}//p' "$0" >&2
    exit 2
}

[ $# -ge 3 ] || usage
action=$1 hosts=$2 run=$(realpath "$3")
shift 3
case $action in
start)
    [ $# -ge 1 ] || usage
    environment=$(realpath "$1")
    shift
    ;;
list | stop) ;;
*) usage ;;
esac

# Runs on each host, as `bash -s ACTION RUN [ENVIRONMENT PROGRAM ARGUMENT...]`. A worker is identified by its pid file; the
# run's name among the process's arguments proves that the pid was not reused.
# shellcheck disable=SC2016
remote='
action=$1 run=$2
shift 2
host=$(uname -n)
pid_file=$run/logs/$host.pid
is_running() {
    [ -s "$pid_file" ] && tr "\0" "\n" 2>/dev/null <"/proc/$(cat "$pid_file")/cmdline" | grep -Fqx -e "$run"
}
case $action in
start)
    if is_running; then echo "$host: already running"; exit 0; fi
    environment=$1 program=$2
    shift 2
    set -a; . "$environment"; set +a
    mkdir -p "$run/logs"
    command -v "$program" >/dev/null || { echo "$host: no $program on PATH"; exit 1; }
    setsid nohup "$program" work "$run" --queue "$GLASSHOUSE_QUEUE" --progress plain "$@" \
        >>"$run/logs/$host.log" 2>&1 </dev/null &
    echo $! >"$pid_file"
    sleep 1
    if is_running; then echo "$host: started"; else echo "$host: ended at once:"; tail -n 3 "$run/logs/$host.log"; exit 1; fi
    ;;
list) if is_running; then echo "$host: runs"; else echo "$host: no worker"; fi ;;
stop) if is_running; then kill -TERM "$(cat "$pid_file")"; echo "$host: asked to stop"; else echo "$host: no worker"; fi ;;
esac
'
arguments=("$action" "$run")
if [ "$action" = start ]; then
    arguments+=("$environment" "${GLASSHOUSE:-glasshouse}" "$@")
fi
printf -v quoted ' %q' "${arguments[@]}"

failed=0
while read -r host; do
    host=${host%%#*}
    host=${host//[[:space:]]/}
    [ -n "$host" ] || continue
    "${SSH:-ssh}" -o BatchMode=yes -o ConnectTimeout=10 "$host" "bash -s --$quoted" <<<"$remote" || {
        echo "error: $host failed" >&2
        failed=1
    }
done <"$hosts"
exit "$failed"
