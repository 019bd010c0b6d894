#!/usr/bin/env bash
# Videos by relight-render, read by ffprobe and ffmpeg.
. "$(dirname "$0")/lib.sh"
sky=(--source sky:size=128x64,time=09:00,speed=20 --size 161x91 --paths direct --method brdf)

# stream FILE ENTRIES: values of ffprobe, separated by commas.
stream() {
    ffprobe -v error -count_packets -show_entries "stream=$2" -of csv=p=0 "$1" | head -n 1 | sed 's/,$//'
}

is() {
    [ "$1" = "$2" ] || fail "'$1' instead of '$2'"
}

videos_have_their_frames_rate_and_colour() {
    local tags=width,height,pix_fmt,color_range,color_space,color_transfer,color_primaries,avg_frame_rate,nb_read_packets
    for kind in mp4:h264 mkv:h264 webm:av1; do
        local file="$work/a.${kind%%:*}"
        "$bin/relight-render" "${sky[@]}" --samples 1 --frames 0-9 --rate 12.5 --out "$file"
        is "$(stream "$file" codec_name)" "${kind##*:}"
        is "$(stream "$file" $tags)" 162,92,yuv420p,tv,bt709,bt709,bt709,25/2,10
    done
    "$bin/relight-render" "${sky[@]}" --samples 1 --frames 0-2 --out "$work/b.mkv"
    is "$(stream "$work/b.mkv" avg_frame_rate)" 30/1
}

# psnr FILE: decibels of Y, Cb and Cr against the pictures, rounded down.
psnr() {
    ffmpeg -v info -i "$1" -framerate 30 -i "$work/%d.png" -f null - -lavfi \
        '[0:v]settb=1/30,setpts=N[a];[1:v]scale=out_color_matrix=bt709:out_range=tv,format=yuv420p,settb=1/30,setpts=N[b];[a][b]psnr' 2>&1 | grep 'PSNR' |
        sed -E 's/.* y:([0-9]+)[^ ]* u:([0-9]+)[^ ]* v:([0-9]+).*/\1 \2 \3/'
}

# As near as ffmpeg's own video of the pictures, by the same encoder at the same quality.
a_video_shows_the_pictures() {
    local same=(--source sky:size=128x64,time=09:00,speed=20 --size 160x90 --paths direct --method brdf --samples 64 --frames 0-4)
    "$bin/relight-render" "${same[@]}" --exposure 0 --out "$work/%d.png"
    for codec in 'mp4 libx264 -preset medium -crf 18' 'webm libsvtav1 -preset 8 -crf 20'; do
        local kind=${codec%% *} a b
        "$bin/relight-render" "${same[@]}" --exposure 0 --quality 100 --out "$work/a.$kind"
        # shellcheck disable=SC2086
        ffmpeg -v error -framerate 30 -i "$work/%d.png" -vf scale=out_color_matrix=bt709:out_range=tv,format=yuv420p -c:v ${codec#* } \
            "$work/b.$kind" 2>/dev/null
        read -ra a < <(psnr "$work/a.$kind")
        read -ra b < <(psnr "$work/b.$kind")
        echo "$kind: ${a[*]} dB; by ffmpeg: ${b[*]} dB"
        for k in 0 1 2; do
            [ "${a[k]}" -ge $((b[k] - 1)) ] && [ "${b[k]}" -ge 30 ] || fail "more than rounding below ffmpeg's"
        done
    done
}

# The signal of 203 cd/m2 is 0.5807 and that of the peak, 1000, 0.7518 [BT.2100]: 573 and 723 of 10 bits.
pq_shows_white_at_203_and_clips_at_the_peak() {
    constant_sky "$work/sky.hdr"
    box_scene "$work"
    for file in "$work/a.mkv" "$work/a.webm"; do
        for want in 0:573 5:723; do
            "$bin/relight-render" --scene "$work/box.json" --source "$work/sky.hdr" --size 160x90 --samples 4 --paths direct \
                --tone pq --exposure "${want%%:*}" --quality 100 --out "$file"
            is "$(stream "$file" pix_fmt,color_range,color_space,color_transfer,color_primaries)" \
                yuv420p10le,tv,bt2020nc,smpte2084,bt2020
            local code
            ffmpeg -v error -y -i "$file" -f rawvideo -pix_fmt yuv420p10le "$work/raw"
            code=$(od -An -N2 -tu2 "$work/raw" | tr -d ' ')
            [ "$code" -ge $((${want##*:} - 2)) ] && [ "$code" -le $((${want##*:} + 2)) ] || fail "$file: $code, not ${want##*:}"
        done
        ffprobe -v error -show_entries stream_side_data "$file" | grep -q 'max_luminance=1000/1\|max_luminance=10000000/10000' ||
            fail "no mastering display in $file"
    done
}

# Neither a broken frame nor an end by force leaves a file that looks whole.
a_video_appears_whole_or_not_at_all() {
    "$bin/relight-render" "${sky[@]}" --samples 512 --frames 0-99 --out "$work/a.mp4" 2>/dev/null &
    local pid=$!
    until ls -A "$work" | grep -q 'a.mp4'; do
        kill -0 $pid || fail "it ended before it wrote anything"
        sleep 0.1
    done
    kill -9 $pid
    wait $pid || true
    [ ! -e "$work/a.mp4" ] || fail "an unfinished video"
    "$bin/relight-render" "${sky[@]}" --samples 1 --frames 0-1 --out "$work/a.mp4"
    is "$(stream "$work/a.mp4" nb_read_packets)" 2
    expect 0 'a.mp4 exists and is replaced' "$bin/relight-render" "${sky[@]}" --samples 1 --frames 0-2 --out "$work/a.mp4"
    is "$(stream "$work/a.mp4" nb_read_packets)" 3
}

# A pipe cannot go back: mp4 comes in fragments, and no format ends with an index.
a_video_can_be_piped_to_another_program() {
    for kind in mp4:h264 mkv:h264 webm:av1; do
        "$bin/relight-render" "${sky[@]}" --samples 1 --frames 0-9 --rate 12.5 --out - --format "${kind%%:*}" |
            ffmpeg -v error -i pipe:0 -c copy -f matroska "$work/a.mkv" -y
        is "$(stream "$work/a.mkv" codec_name,width,height,avg_frame_rate,nb_read_packets)" "${kind##*:},162,92,25/2,10"
    done
    "$bin/relight-render" "${sky[@]}" --samples 1 --frames 0-4 --out - --format jpg |
        ffmpeg -v error -f image2pipe -c:v mjpeg -i pipe:0 -c copy "$work/b.mkv"
    is "$(stream "$work/b.mkv" codec_name,nb_read_packets)" mjpeg,5
    local got=0
    "$bin/relight-render" "${sky[@]}" --samples 1 --frames 0-99 --out - --format mkv 2>"$work/stderr" | head -c 100 >"$work/head" ||
        got=${PIPESTATUS[0]}
    is "$got" 1
    grep -q 'standard output: writing: Broken pipe' "$work/stderr" || { cat "$work/stderr"; fail "no message"; }
}

what_no_video_takes_is_refused() {
    expect 2 "must end in .exr, .jpg, .png, .mp4, .mkv or .webm" "$bin/relight-render" "${sky[@]}" --out "$work/a.avi"
    expect 2 "a video holds all frames; leave out the %d" "$bin/relight-render" "${sky[@]}" --out "$work/%d.mp4"
    expect 2 "--tone pq is for --out in .mp4, .mkv or .webm, not in .jpg" "$bin/relight-render" "${sky[@]}" --tone pq --out "$work/a.jpg"
    expect 2 "--bits 16 is for --out in .png, not in .mp4" "$bin/relight-render" "${sky[@]}" --bits 16 --out "$work/a.mp4"
    expect 1 "No such file or directory" "$bin/relight-render" "${sky[@]}" --out "$work/none/a.mp4"
    expect 1 "AV1 needs 64x64 pixels at least" "$bin/relight-render" "${sky[@]}" --size 16x16 --out "$work/a.webm"
    expect 0 "--rate has no effect: it is for video files" "$bin/relight-render" "${sky[@]}" --samples 1 --rate 5 --out "$work/a.png"
    [ -z "$(ls "$work" | grep -v 'a.png\|std\|cache')" ] || { ls "$work"; fail "something was left"; }
}

"$1"
