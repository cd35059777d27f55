#!/usr/bin/env bash
# The demo: Puget Sound at 1 m, built, checked, flown over, looked at from above; the Rocky Mountains under an image; Delft as BlockMaps.
# demo.sh KMB BUILD_FOLDER OUTPUT_FOLDER
set -euo pipefail
kmb=$1 programs=$2/c_examples out=$3
repository=$out/puget_sound.kmb
raster=data/puget_sound_1025_decimetres.png
mkdir -p "$out"
rm -rf "$out"/flight "$out"/levels "$out"/steep "$out"/colours "$out"/city "$out"/summary.txt "$out"/*.png

# Samples are decimetres: 10 of them are 1 m.
placed=(--spacing 160 --scale 0.1)
echo "== $raster at 1 m"
"$kmb" build "$raster" -o "$repository" "${placed[@]}" --max-error 10 --json > "$out/build.json"
"$kmb" verify "$repository" --against "$raster" --json > "$out/verify.json"
echo "== 240 frames without a picture: times, cracks"
"$kmb" fly "$repository" --frames 240 --size 1280x1024 --json > "$out/fly.json"
echo "== 240 frames under OSMesa"
"$programs/flyover" "$repository" --frames 240 --size 1280x1024 --every 16 --still 60 --out "$out/flight"
"$programs/flyover" "$repository" --frames 240 --size 1280x1024 --every 80 --levels --out "$out/levels"
echo "== 200 views from above over a background that no terrain has"
"$programs/flyover" "$repository" --steep 200 --size 1280x1024 --every 50 --background 255,0,255 --out "$out/steep"
echo "== the Rocky Mountains under a Landsat image, and with detail beyond their heights"
rocky=$out/rocky_mountains image=data/rocky_mountain_np_landsat_rgb
"$kmb" build data/rocky_mountain_np_dem.tif -o "$rocky.kmb" --max-error 1 --json > "$out/rocky.json"
"$kmb" build "$image.png" -o "$rocky.colours.kmb" --colour --max-error 0 --domain-of "$rocky.kmb" \
    --bounds -106.0566 40.0602 -105.3291 40.6197 --json > "$out/rocky_colours.json"
"$kmb" fly "$rocky.kmb" --colour "$rocky.colours.kmb" --frames 120 --size 1280x1024 --json > "$out/fly_colours.json"
"$programs/flyover" "$rocky.kmb" --colour "$rocky.colours.kmb" --frames 120 --size 1280x1024 --every 40 \
    --detail 4 --roughness 0.05 --meter --out "$out/colours"
echo "== a part of Delft as BlockMaps, drawn by a shader"
"$kmb" build-city data/city/delft_lod1.city.json -o "$out/delft.kmb" --facades 7 --json > "$out/delft.json"
"$kmb" verify "$out/delft.kmb" --json > "$out/delft_verify.json"
"$programs/city" "$out/delft.kmb" --frames 24 --size 1280x1024 --every 6 --out "$out/city"
echo "== the viewer in a window"
xvfb-run -a -s "-screen 0 1280x1024x24" "$programs/viewer" "$repository" --frames 60 --screenshot "$out/viewer.png"

montage "$out"/flight/*.png -geometry 480x384+4+4 -tile 4x -background '#202020' "$out/contact_sheet.png"
{
    echo "Puget Sound, 1025 x 1025 samples, 160 m apart, maximum error 1 m"
    for part in build verify fly rocky rocky_colours fly_colours delft delft_verify; do printf '\n%s\n' "$part"; cat "$out/$part.json"; done
    for part in flight steep colours city; do printf '\n%s\n' "$part"; cat "$out/$part/summary.json"; done
} > "$out/summary.txt"
echo "== pictures and summary in $out: contact_sheet.png, summary.txt"
