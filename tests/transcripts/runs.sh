# For transcripts that do something to a run while it goes on.
set -m
trap 'for job in $(jobs -p); do kill -KILL -- -$job; done 2> /dev/null || true' EXIT
# A wait without an end is cut short.
{ sleep 600; kill -KILL $$; } > /dev/null 2>&1 &

# ARGUMENTS: a run, with its output in `out` and `err`; `launcher` is its process.
start() {
    # A caller in the background, or under nohup, lets its programs ignore signals that these tests send.
    env --default-signal=HUP,INT,QUIT "$ARMPLANE" "$@" > out 2> err &
    launcher=$!
    # Until then it is this shell, which takes a signal for its own.
    while [ -e /proc/$launcher/exe ] && ! [ /proc/$launcher/exe -ef $ARMPLANE ]; do :; done
}

# The name of its directory in shared memory.
name() {
    ls /dev/shm | grep -e "-$launcher-[^.]*$" || true
}

# Ticks that it has begun.
ticks() {
    armplane top --run "$(name)" --once --json 2> /dev/null | grep -o '"ticks":[0-9]*' | head -1 | cut -d: -f2 | grep . || echo 0
}

# ARGUMENTS: a run that has begun 100 ticks.
begin() {
    start "$@"
    until [ "$(ticks)" -gt 100 ]; do sleep 0.01; done
}

# PROCESS: its process, if it lives.
pid() {
    pgrep -f "[ ]$1 --run /dev/shm/armplane-[^ ]*-$launcher-" || true
}

# PROCESS SIGNAL: sends it, and waits until another process is there.
replaced() {
    before=$(pid $1)
    kill -$2 $before
    until now=$(pid $1) && [ "$now" ] && [ "$now" != "$before" ]; do sleep 0.01; done
}

# Waits for its end. It leaves nothing; its output is printed, and its exit code returned.
ended() {
    # 147: with job control, a launcher that was stopped and goes on counts as waited for. `wait -f`, which does not count that, may never return.
    while code=0; wait $launcher || code=$?; [ $code = 147 ]; do sleep 0.01; done
    cat out
    cat err >&2
    if ls /dev/shm | grep -e "-$launcher-" || pgrep -f "[ ]--run /dev/shm/armplane-[^ ]*-$launcher-"; then exit 99; fi
    return $code
}

# After the launcher was killed: waits until its processes are gone.
orphaned() {
    kill -KILL $launcher
    while pgrep -f "[ ]--run /dev/shm/armplane-[^ ]*-$launcher-" > /dev/null; do sleep 0.01; done
}

# FILE BYTES: waits until it has so many.
grown() {
    until [ "$(stat -c %s $1 2> /dev/null || echo 0)" -gt $2 ]; do sleep 0.01; done
}
