#!/usr/bin/env bash
# Trains the shipped predictor `siren`: draws six small road networks with SUMO's netgenerate, and trains on them and on maps of real
# places. Run it in the repository's root, with CARLA's maps and WestOakland.osm there: bash examples/train_siren.sh
# Another folder for the work, another folder of the maps, further options: bash examples/train_siren.sh DIR MAPS --seed 1
set -euo pipefail
work=${1:-trained}
maps=${2:-.}
mkdir -p "$work/maps"
drawn=()

draw() {
    local name=$1
    shift
    ./env netgenerate --no-warnings --no-turnarounds --junctions.corner-detail 5 --junctions.internal-link-detail 10 --default.speed 13.9 \
        --output-file "$work/maps/$name.net.xml" "$@"
    drawn+=("$work/maps/$name.net.xml")
}

streets=(--rand --rand.min-angle 60 --random-lanenumber)
draw drawn_signals "${streets[@]}" --seed 1 --rand.iterations 60 --rand.min-distance 120 --rand.max-distance 300 \
    --default.lanenumber 3 --default.junctions.type traffic_light --turn-lanes 1 --turn-lanes.length 50
draw drawn_stops "${streets[@]}" --seed 2 --rand.iterations 60 --rand.min-distance 100 --rand.max-distance 220 \
    --default.lanenumber 2 --default.junctions.type allway_stop
draw drawn_mixed "${streets[@]}" --seed 3 --rand.iterations 70 --rand.min-distance 120 --rand.max-distance 280 \
    --default.lanenumber 3 --default.junctions.type priority_stop --random-priority --tls.guess --tls.guess.threshold 50
draw drawn_blocks --seed 4 --grid --grid.number 5 --grid.length 180 --grid.attach-length 150 \
    --perturb-x 'norm(0,15)' --perturb-y 'norm(0,15)' \
    --default.lanenumber 2 --default.junctions.type traffic_light --turn-lanes 1
draw drawn_stop_blocks --seed 6 --grid --grid.number 5 --grid.length 150 --grid.attach-length 150 \
    --perturb-x 'norm(0,15)' --perturb-y 'norm(0,15)' \
    --default.lanenumber 2 --default.junctions.type allway_stop
draw drawn_ring --seed 5 --spider --spider.arm-number 6 --spider.circle-number 3 --spider.space-radius 150 \
    --spider.attach-length 120 --default.lanenumber 2 --default.junctions.type priority_stop --tls.guess

./env --with models siren train prediction --out "$work" --maps town "$maps/Town04.xodr" "$maps/WestOakland.osm" "${drawn[@]}" \
    --held-out-maps "$maps/Town07.xodr" "$maps/Town10HD_Opt.xodr" --train-seeds 9 --validation-seeds 1 --test-seeds 1 "${@:3}"
