#!/usr/bin/env bash
# Generates the episodes on which the shipped detector `pillars` was trained, and trains it: pillars.onnx and pillars.json.
# Run it in the repository's root, with CARLA's Town04.xodr there: bash examples/train_pillars.sh
# Another folder for the work and another place of the map: bash examples/train_pillars.sh DIR FILE.xodr
set -euo pipefail
work=${1:-.}
town04=${2:-Town04.xodr}

# Three emergency vehicles of one kind in each template, 2 s apart: the LiDAR of the first one sees the others.
for kind in ambulance fire_truck police; do
    mkdir -p "$work/$kind"
    for id in S1 S2 S3 S4 S5 S6 S7; do
        sed -e "s/^  class: ambulance/  class: $kind/" -e "s/^  count: 1/  count: 3/" params/templates/$id.yaml > "$work/$kind/$id.yaml"
    done
done
while read -r out seed map look templates; do
    if [[ $map == Town04.xodr ]]; then map=$town04; fi
    # shellcheck disable=SC2086 # the pattern stands for several templates
    ./env siren generate --templates "$work"/$templates --seeds "$seed" --maps "$map" --look "$look" --grid emv.headway_s=2 \
        --sensors lidar --duration-s 14 --out "$work/bags/$out" < /dev/null
done <<END
ambulance-town    103 town        clear ambulance/S?.yaml
ambulance-town04  106 Town04.xodr clear ambulance/S[12347].yaml
fire_truck-rain   107 town        rain  fire_truck/S?.yaml
fire_truck-town   101 town        clear fire_truck/S?.yaml
fire_truck-town04 104 Town04.xodr clear fire_truck/S[12347].yaml
police-fog        108 town        fog   police/S?.yaml
police-town       102 town        clear police/S?.yaml
police-town04     105 Town04.xodr clear police/S[12347].yaml
END
./env --with models siren train detection "$work/bags/" --steps 3000 --out "$work/pillars.onnx"
./env --with models siren train detection "$work/bags/" --steps 4400 --out "$work/pillars.onnx"
