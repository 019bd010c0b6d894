#!/usr/bin/env python3
"""Writes a time-lapse of the sky as a fixed camera takes it: lat-long EXR images, one every few seconds, in which clouds drift
at one speed before a sun of 0.533 degrees on its true arc, and truth.json, which says of each image when it was taken, where
the sun is, how far the clouds have moved and what was done to it.

Images are named by their local time (sky_20240612_143005.exr) and carry it as capDate and utcOffset, with expTime. Their
centre is north, a quarter to the left is west. A clear sky is about 0.5 to 1, the sun up to 2e5 (with --half a quarter of both).
Options that begin with "harm" in their help spoil what the camera sees; all others change the sky itself.

    python3 timelapse.py FOLDER --count 40
    python3 timelapse.py FOLDER --count 40 --jitter 5 --wb 3 --clip 4 --drop 0.1 --irregular
"""
import argparse
import datetime
import json
import math
import pathlib
import random
import struct
import sys

import proof

SUN_RADIUS = math.radians(0.533 / 2)
ZENITH, HORIZON = (0.13, 0.33, 0.72), (0.42, 0.3, 0.02)  # the clear sky's colour, and what the horizon has in addition
HEIGHT_M = 1500  # of the clouds' base: distances on its plane are in units of it
LOW = 0.15  # clouds are shown at their places d / (d_y + LOW), so that the horizon is not infinitely far


def sun_direction(latitude, longitude, when):
    """Y up, north +Z, east -X; within 0.01 degrees, without refraction [The Astronomical Almanac, low precision]."""
    days = (when - datetime.datetime(2000, 1, 1, 12, tzinfo=datetime.timezone.utc)).total_seconds() / 86400
    anomaly = math.radians(357.528 + 0.9856003 * days)
    along = math.radians(280.460 + 0.9856474 * days + 1.915 * math.sin(anomaly) + 0.020 * math.sin(2 * anomaly))
    tilt = math.radians(23.439 - 4e-7 * days)
    ascension = math.atan2(math.cos(tilt) * math.sin(along), math.cos(along))
    up = math.sin(tilt) * math.sin(along)  # sine of the declination
    out = math.cos(math.asin(up))
    turn = math.radians(280.46062 + 360.98564737 * days + longitude) - ascension  # hour angle
    lat = math.radians(latitude)
    return (out * math.sin(turn), math.sin(lat) * up + math.cos(lat) * out * math.cos(turn),
            math.cos(lat) * up - math.sin(lat) * out * math.cos(turn))


def camera_matrix(options):
    """Rows: the camera's axes, so that a direction of an image is the transposed matrix times one of the world's."""
    r, t = math.radians(options.rotate), math.radians(options.tilt)
    mirror = -1 if options.mirror else 1
    turn = (math.cos(r), 0, math.sin(r)), (0, 1, 0), (-math.sin(r), 0, math.cos(r))
    lean = (1, 0, 0), (0, math.cos(t), -math.sin(t)), (0, math.sin(t), math.cos(t))
    rows = [[sum(turn[i][k] * lean[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
    return [[row[0] * mirror, row[1], row[2]] for row in rows]


def to_image(matrix, d):
    return [sum(matrix[i][j] * d[i] for i in range(3)) for j in range(3)]


def pixels_of(size, matrix):
    """Those that see the sky: index, direction in the world, place on the clouds' plane in samples of the tile, colours."""
    scale, out = proof.TEXELS / proof.PERIOD, []
    for y in range(size[1]):
        for x in range(size[0]):
            d = proof.direction((x + 0.5) / size[0], (y + 0.5) / size[1])
            dx, dy, dz = (sum(a * b for a, b in zip(row, d)) for row in matrix)
            if dy > 0:
                far = scale / (dy + LOW)
                out.append((y * size[0] + x, dx, dy, dz, dx * far, dz * far, min(1.0, dy / 0.15),
                            *(c + h * (1 - dy) ** 2 for c, h in zip(ZENITH, HORIZON))))
    return out


class Clouds:
    """How much of the sky is covered, from 0 to 1, on a plane whose pattern repeats and moves as a whole."""

    def __init__(self, cover, wind, rng):
        n = proof.TEXELS
        small = proof.tile(rng)
        rows = [[0.65 * small[j][i] + 0.35 * small[j * 3 % n][i * 3 % n] for i in range(n)] for j in range(n)]
        level = sorted(v for row in rows for v in row)[min(n * n - 1, int((1 - cover) * n * n))]
        rows = [[min(1.0, max(0.0, (v - level) * 7 + 0.5 * (0 < cover < 1))) if cover > 0 else 0.0 for v in row] for row in rows]
        self.mean = sum(map(sum, rows)) / n ** 2
        self.flat = [v for row in rows for v in (*row, row[0])]  # each row's end is its start again
        self.flat += self.flat[:n + 1]
        self.wind = [k / HEIGHT_M for k in wind]

    def moved(self, seconds):
        return [k * seconds for k in self.wind]

    def at(self, u, v):
        """In samples of the tile."""
        n = proof.TEXELS
        u, v = u % n, v % n
        i, j = int(u) % n, int(v) % n
        a, b, k = u - i, v - j, j * (n + 1) + i
        t = self.flat
        return (t[k] * (1 - a) + t[k + 1] * a) * (1 - b) + (t[k + n + 1] * (1 - a) + t[k + n + 2] * a) * b

    def over(self, d, seconds):
        """In a direction of the world."""
        scale, (ax, az), haze = proof.TEXELS / proof.PERIOD, self.moved(seconds), min(1.0, d[1] / 0.15)
        far = 1 / (d[1] + LOW)
        return haze * self.at((d[0] * far - ax) * scale, (d[2] * far - az) * scale) + (1 - haze) * self.mean


def sun_texels(size, sun):
    """The texels that the sun touches and the part of each that it covers, so that their sum has the disc's solid angle."""
    w, h = size
    theta, phi = math.acos(max(-1.0, min(1.0, sun[1]))), math.atan2(sun[0], sun[2])
    reach = 1.5 * SUN_RADIUS
    y0, y1 = (int((theta + k * reach) / math.pi * h) for k in (-1, 1))
    wide = w if min(theta, math.pi - theta) < 3 * reach else int(reach / math.sin(theta) * w / (2 * math.pi)) + 2
    x0 = int((math.pi - phi) / (2 * math.pi) * w)
    found, total, limit = [], 0.0, math.cos(SUN_RADIUS)
    for y in range(max(0, y0), min(h - 1, y1) + 1):
        solid = 2 * math.pi / w * (math.cos(math.pi * y / h) - math.cos(math.pi * (y + 1) / h))
        for x in sorted({k % w for k in range(x0 - wide, x0 + wide + 1)}):
            inside = sum(sum(a * b for a, b in zip(proof.direction((x + (i + 0.5) / 16) / w, (y + (j + 0.5) / 16) / h), sun)) > limit
                         for j in range(16) for i in range(16))
            if inside:
                found.append((y * w + x, inside / 256))
                total += inside / 256 * solid
    whole = 2 * math.pi * (1 - limit)
    if not found:  # smaller than the grid of samples
        y = min(h - 1, int(theta / math.pi * h))
        solid = 2 * math.pi / w * (math.cos(math.pi * y / h) - math.cos(math.pi * (y + 1) / h))
        return [(y * w + x0 % w, whole / solid)]
    return [(k, part * whole / total) for k, part in found]


def twilight(sun):
    """Of a high sun's sky: it fades from 8 degrees on, faster and faster, and by 1.1 stops a degree from -2 to -12."""
    degrees = math.degrees(math.asin(max(-1.0, min(1.0, sun[1]))))
    below = min(20.0, max(0.0, 8 - degrees))
    return 2.0 ** -(0.055 * min(10.0, below) ** 2 + 1.1 * max(0.0, below - 10))


def sky(size, pixels, clouds, sun, seconds, options, veiled):
    """Three planes without the sun's disc, and the part of the sun that the clouds let through. veiled: by one more cloud."""
    n = proof.TEXELS
    mass = 1 / max(0.03, sun[1] + 0.05)
    white = r_sun, g_sun, b_sun = [math.exp(-t * mass) for t in (0.07, 0.1, 0.18)]
    dusk = twilight(sun)
    bright = (0.25 + 0.75 * max(0.0, sun[1])) * dusk
    ax, az = (k * n / proof.PERIOD for k in clouds.moved(seconds))
    flat, mean, (sx, sy, sz) = clouds.flat, clouds.mean, sun
    ground = [c * bright for c in (0.12, 0.11, 0.1)]
    red, green, blue = ([c] * (size[0] * size[1]) for c in ground)
    hole, patch = (0.99, 1.0 / 0.0094) if options.clear_sun else (2.0, 1.0), 0.995 if veiled else 2.0
    for k, dx, dy, dz, u, v, haze, r, g, b in pixels:
        u, v = (u - ax) % n, (v - az) % n
        i, j = int(u), int(v)
        if i == n or j == n:  # a tiny negative number's remainder rounds up
            i, j = i % n, j % n
        s, t, m = u - i, v - j, j * (n + 1) + i
        cloud = (flat[m] * (1 - s) + flat[m + 1] * s) * (1 - t) + (flat[m + n + 1] * (1 - s) + flat[m + n + 2] * s) * t
        cloud = haze * cloud + (1 - haze) * mean
        near = dx * sx + dy * sy + dz * sz
        if near > 0.9:
            if near > hole[0]:
                cloud *= min(1.0, max(0.0, (0.9994 - near) * hole[1]))
            if near > patch:
                cloud = 1.0
            n8 = near ** 8
            glow = 1.5 * dusk * near ** 60
        else:
            n8 = near ** 8 if near > 0.3 else 0.0
            glow = 0.0
        clear = 1 - cloud
        grey = cloud * bright * (0.85 + 1.2 * n8 + 0.5 * clear)
        red[k] = clear * (bright * r + glow * r_sun) + grey * (0.55 + 0.45 * r_sun)
        green[k] = clear * (bright * g + glow * g_sun) + grey * (0.55 + 0.45 * g_sun)
        blue[k] = clear * (bright * b + glow * b_sun) + grey * (0.55 + 0.45 * b_sun)
    through = 1 - 0.999 * (0.0 if options.clear_sun else clouds.over(sun, seconds)) if sun[1] > -SUN_RADIUS else 0.0
    return (red, green, blue), [through * w * (0.1 if veiled else 1.0) for w in white]


def moments(options, rng):
    """Seconds of the images since the first, and their numbers."""
    out = []
    for k in range(options.count):
        late = rng.uniform(-0.4, 0.4) * options.step if options.irregular and k > 0 else 0.0
        dropped = k > 0 and rng.random() < options.drop
        if k % options.every == 0 and not dropped:
            out.append((k, k * options.step + late))
    return out


def camera_gains(options, rng, frame):
    """Of the three channels."""
    jump = 2.0 ** options.jump[1] if options.jump and frame >= options.jump[0] else 1.0
    exposure = math.exp(rng.gauss(0, 1) * options.jitter / 100)
    return [jump * exposure * math.exp(rng.gauss(0, 1) * options.wb / 100) for _ in range(3)]


def write_frame(path, planes, gains, when, options, size):
    level = 2.0 ** options.clip if options.clip is not None else math.inf
    scale = 0.25 if options.half else 1.0
    planes = [[min(v * g, level) * scale for v in plane] for plane, g in zip(planes, gains)]
    more = b""
    if not options.no_times:
        more = proof.attribute("capDate", "string", when.strftime("%Y:%m:%d %H:%M:%S").encode()) + \
            proof.attribute("utcOffset", "float", struct.pack("<f", -3600 * options.zone)) + \
            proof.attribute("expTime", "float", struct.pack("<f", options.exposure))
    proof.write_exr(path, planes, size, options.half, False, more)


def write_timelapse(options):
    size = options.width, options.width // 2
    zone = datetime.timezone(datetime.timedelta(hours=options.zone))
    start = datetime.datetime.fromisoformat(f"{options.date}T{options.time}").replace(tzinfo=zone)
    of_sky, of_times, of_camera = (random.Random(f"{options.seed} {what}") for what in ("sky", "times", "camera"))
    clouds, matrix = Clouds(options.cover, options.wind, of_sky), camera_matrix(options)
    pixels, truth = pixels_of(size, matrix), []
    for frame, seconds in moments(options, of_times):
        when = start + datetime.timedelta(seconds=round(seconds, 3))
        sun = sun_direction(options.latitude, options.longitude, when)
        veiled = options.cloud_over_sun is not None and frame >= options.cloud_over_sun
        planes, through = sky(size, pixels, clouds, sun, seconds, options, veiled)
        for k, part in sun_texels(size, to_image(matrix, sun)) if sun[1] > -SUN_RADIUS else []:
            y = proof.direction((k % size[0] + 0.5) / size[0], (k // size[0] + 0.5) / size[1])
            if sum(a * b for a, b in zip(matrix[1], y)) > 0:  # the horizon hides the rest
                for plane, light in zip(planes, through):
                    plane[k] += proof.SUN_RADIANCE * part * light
        gains = camera_gains(options, of_camera, frame)
        second = when.strftime("%Y%m%d_%H%M%S") + (f".{when.microsecond // 1000:03d}" if options.step % 1 or options.irregular else "")
        name = f"sky.{frame}.exr" if options.numbered else f"sky_{second}.exr"
        write_frame(options.folder / name, planes, gains, when, options, size)
        truth.append({"file": name, "frame": frame, "unix": when.timestamp(), "sun": sun, "sun_in_image": to_image(matrix, sun),
                      "sun_through": through, "clouds_moved": clouds.moved(seconds), "gains": gains})
    (options.folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")


def jump(text):
    frame, _, stops = text.partition(":")
    return int(frame), float(stops)


def parse():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("folder", type=pathlib.Path, metavar="FOLDER")
    p.add_argument("--count", type=int, default=20, metavar="N", help="images, before any are left out [20]")
    p.add_argument("--step", type=float, default=15, metavar="SECONDS", help="between two of them [15]")
    p.add_argument("--width", type=int, default=512, metavar="TEXELS", help="of an image, twice its height [512]")
    p.add_argument("--latitude", type=float, default=45, metavar="DEG", help="north is positive [45]")
    p.add_argument("--longitude", type=float, default=0, metavar="DEG", help="east is positive [0]")
    p.add_argument("--date", default="2024-06-12", help="YYYY-MM-DD [2024-06-12]")
    p.add_argument("--time", default="14:30:05", help="of the first image, hh:mm:ss local time [14:30:05]")
    p.add_argument("--zone", type=float, default=0, metavar="HOURS", help="local time before UTC [0]")
    p.add_argument("--cover", type=float, default=0.45, metavar="PART", help="of the sky with clouds; 0: clear [0.45]")
    p.add_argument("--wind", type=float, nargs=2, default=(10, 4), metavar=("X", "Z"),
                   help="of clouds 1500 m above, m/s towards +X (west) and +Z (north) [10 4]")
    p.add_argument("--clear-sun", action="store_true", help="no drifting cloud comes within 2 degrees of the sun")
    p.add_argument("--cloud-over-sun", type=int, metavar="FRAME", help="from this image on a cloud takes 90 %% of the sun")
    p.add_argument("--half", action="store_true", help="half floats, all values divided by 4")
    p.add_argument("--numbered", action="store_true", help="names without time: sky.0.exr, sky.1.exr ..")
    p.add_argument("--no-times", action="store_true", help="without capDate, utcOffset and expTime")
    p.add_argument("--exposure", type=float, default=0.001, metavar="SECONDS", help="what expTime says [0.001]")
    p.add_argument("--seed", type=int, default=1, help="of clouds and harm [1]")
    p.add_argument("--clip", type=float, metavar="STOPS", help="harm: values end at 2^STOPS; a clear sky is 0.5 to 1")
    p.add_argument("--jitter", type=float, default=0, metavar="PERCENT", help="harm: exposure, of each image by chance")
    p.add_argument("--wb", type=float, default=0, metavar="PERCENT", help="harm: white balance, of each channel by chance")
    p.add_argument("--jump", type=jump, metavar="FRAME:STOPS", help="harm: exposure changes at an image and stays")
    p.add_argument("--drop", type=float, default=0, metavar="PART", help="harm: images that are missing, by chance")
    p.add_argument("--every", type=int, default=1, metavar="K", help="harm: only each K-th image is written")
    p.add_argument("--irregular", action="store_true", help="harm: times differ by up to 0.4 steps")
    p.add_argument("--rotate", type=float, default=0, metavar="DEG", help="harm: the centre looks that far west of north")
    p.add_argument("--tilt", type=float, default=0, metavar="DEG", help="harm: the centre looks down by that")
    p.add_argument("--mirror", action="store_true", help="harm: left and right are exchanged")
    return p, p.parse_args()


def main():
    parser, options = parse()
    if options.count < 1 or options.step <= 0 or options.width < 4 or options.width % 2 or options.every < 1:
        parser.error("--count, --step and --every are above 0, --width is an even number above 2")
    if not (0 <= options.cover <= 1 and 0 <= options.drop < 1 and abs(options.latitude) <= 90):
        parser.error("--cover is 0 to 1, --drop below 1, --latitude -90 to 90")
    try:
        options.folder.mkdir(parents=True, exist_ok=True)
        write_timelapse(options)
    except (OSError, ValueError) as fault:
        sys.exit(f"timelapse.py: {fault}")


if __name__ == "__main__":
    main()
