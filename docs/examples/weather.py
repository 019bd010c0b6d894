#!/usr/bin/env python3
"""Writes a plausible EnergyPlus weather file (.epw) for any place, to try relightd without a measured one.

    docs/examples/weather.py --latitude 51.5 --longitude 0 --zone 0 > somewhere.epw

Clear-sky irradiance is that of a simple turbid atmosphere; a cloud cover that drifts from hour to hour, by a seed, divides
it into direct and diffuse. It is no substitute for the weather file of a real place.
"""
import argparse
import math
import random
import sys

DAYS = [31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31]


def sun_altitude(latitude, longitude, zone, day, clock):
    """Sine of the sun's altitude [Spencer 1971]."""
    g = 2 * math.pi * (day - 1 + 1.15 + (clock - 12) / 24) / 365  # as server/sky/daylight/sun.c
    declination = (0.006918 - 0.399912 * math.cos(g) + 0.070257 * math.sin(g) - 0.006758 * math.cos(2 * g)
                   + 0.000907 * math.sin(2 * g) - 0.002697 * math.cos(3 * g) + 0.00148 * math.sin(3 * g))
    minutes = 229.18 * (0.000075 + 0.001868 * math.cos(g) - 0.032077 * math.sin(g)
                        - 0.014615 * math.cos(2 * g) - 0.04089 * math.sin(2 * g))
    turn = math.radians(15 * (clock + longitude / 15 - zone + minutes / 60 - 12))
    latitude = math.radians(latitude)
    return math.sin(latitude) * math.sin(declination) + math.cos(latitude) * math.cos(declination) * math.cos(turn)


def irradiance(place, day, hour, cloud):
    """Direct normal and diffuse horizontal, W/m2: the mean over the hour that ends at `hour`."""
    direct = diffuse = 0.0
    steps = 12
    for k in range(steps):
        up = sun_altitude(*place, day, hour - 1 + (k + 0.5) / steps)
        if up <= 0:
            continue
        degrees = math.degrees(math.asin(up))
        air_mass = 1 / (up + 0.15 * (degrees + 3.885) ** -1.253)
        outside = 1367 * (1 + 0.033 * math.cos(2 * math.pi * day / 365))
        clear = outside * math.exp(-0.26 * air_mass ** 0.75)
        direct += clear * max(0.0, 1 - cloud) ** 1.5 / steps
        diffuse += (0.09 * outside * up ** 0.6 * (1 - cloud) + 0.33 * outside * up * cloud) / steps
    return direct, diffuse


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--latitude", type=float, default=51.5, help="degrees, north positive (51.5)")
    parser.add_argument("--longitude", type=float, default=0.0, help="degrees, east positive (0)")
    parser.add_argument("--zone", type=float, default=0.0, help="hours ahead of UTC (0)")
    parser.add_argument("--seed", type=int, default=1, help="of the clouds (1)")
    parser.add_argument("--clouds", type=float, default=0.5, help="mean cloud cover, 0 to 1 (0.5)")
    a = parser.parse_args()
    place = (a.latitude, a.longitude, a.zone)
    draw = random.Random(a.seed)
    out = sys.stdout
    out.write(f"LOCATION,Generated,-,-,relightd weather.py,0,{a.latitude:g},{a.longitude:g},{a.zone:g},0\n")
    out.write("DESIGN CONDITIONS,0\nTYPICAL/EXTREME PERIODS,0\nGROUND TEMPERATURES,0\n")
    out.write("HOLIDAYS/DAYLIGHT SAVINGS,No,0,0,0\nCOMMENTS 1,generated: no measured weather\nCOMMENTS 2,\n")
    out.write("DATA PERIODS,1,1,Data,Sunday, 1/ 1,12/31\n")
    cloud, day = a.clouds, 0
    for month, days in enumerate(DAYS, 1):
        for of_month in range(1, days + 1):
            day += 1
            for hour in range(1, 25):
                cloud += 0.25 * (a.clouds - cloud) + 0.28 * draw.gauss(0, 1)
                cloud = min(1.0, max(0.0, cloud))
                direct, diffuse = irradiance(place, day, hour, cloud)
                up = max(0.0, sun_altitude(*place, day, hour - 0.5))
                warm = 10 - 8 * math.cos(2 * math.pi * (day - 20) / 365) * (1 if a.latitude >= 0 else -1)
                dew = warm - 5
                out.write(f"2021,{month},{of_month},{hour},0,?9,{warm:.1f},{dew:.1f},70,101325,9999,9999,9999,"
                          f"{direct * up + diffuse:.0f},{direct:.0f},{diffuse:.0f},999999,999999,999999,9999,"
                          f"180,3.0,{10 * cloud:.0f},{10 * cloud:.0f},9999,99999,9,999999999,99,0.1,0,88,0.2,0,0\n")


if __name__ == "__main__":
    main()
