#!/usr/bin/python3
"""GStreamer's RTSP server: rtsp_server.py [WIDTH HEIGHT FPS]. It shows a test picture (live.py), or the grey frames of that size
that it reads (latency.py). Prints its port."""

import sys
import threading

import gi

gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer

Gst.init(None)
server = GstRtspServer.RTSPServer()
server.set_address("127.0.0.1")
server.set_service("0")
factory = GstRtspServer.RTSPMediaFactory()
width, height, rate = map(int, sys.argv[1:] or (256, 128, 25))
picture = "videotestsrc is-live=true"
if sys.argv[1:]:
    picture = "appsrc name=frames is-live=true do-timestamp=true format=time"
factory.set_launch(f"( {picture} ! video/x-raw,width={width},height={height},framerate={rate}/1"
                   f"{',format=I420' if sys.argv[1:] else ''} ! "
                   f"vp8enc deadline=1 keyframe-max-dist={rate} ! rtpvp8pay name=pay0 pt=96 )")
factory.set_shared(True)
sinks = []


def read_frames():
    limited = bytes(round(16 + 219 * code / 255) for code in range(256))
    chroma = bytes([128]) * (width * height // 2)
    while frame := sys.stdin.buffer.read(width * height):
        for sink in sinks:
            sink.emit("push-buffer", Gst.Buffer.new_wrapped(frame.translate(limited) + chroma))


if sys.argv[1:]:
    factory.connect("media-configure", lambda _, media: sinks.append(media.get_element().get_by_name("frames")))
    threading.Thread(target=read_frames, daemon=True).start()
server.get_mount_points().add_factory("/sky", factory)
server.attach(None)
print(server.get_bound_port(), flush=True)
GLib.MainLoop().run()
