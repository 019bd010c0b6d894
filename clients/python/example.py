#!/usr/bin/python3
"""Feeds relightd a light that circles the horizon and saves what the scene looks like, as radiance: example.py [ws://HOST:PORT] [COUNT].
Start the server with `relightd --source push:`."""

import sys

import numpy

import relightd

url = sys.argv[1] if len(sys.argv) > 1 else "ws://localhost:8080"
count = int(sys.argv[2]) if len(sys.argv) > 2 else 8
with relightd.connect(url, "producer") as producer, relightd.connect(url) as viewer:
    viewer.subscribe("exr_half")
    for i in range(count):
        sky = numpy.full((128, 256, 3), 0.2, numpy.float32)  # latitude, longitude, RGB
        sky[50:60, 256 * i // count:][:, :16] = 40.0
        producer.feed(sky, i, layout="latlong")
        picture = next(p for p in viewer.pictures() if p.frame == i)
        numpy.save(f"radiance.{i}.npy", picture.radiance())
        print(f"radiance.{i}.npy: mean {picture.radiance().mean():.4f}")
