#!/usr/bin/python3
"""Faults of scene files (group G): what a model may do to the process that reads it costs a message, and an exit code."""

import asyncio
import json
import os
import struct
import time
import zlib

from faults import SANITIZED, Relightd, Viewer, check, main, row, skip
from peer import Failed, Program

MEMORY_MB = 600
CAMERA = {"position": [0, 1, 5], "look_at": [0, 0, 0], "fov_y_degrees": 40}
SMALL_SKY = "sky:size=128x64"  # a large one is computed while the scene is read
GREY = {"grey": {"type": "lambert", "albedo": [0.5, 0.5, 0.5]}}
SQUARE = struct.pack("<12f", 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0) + struct.pack("<6H", 0, 1, 2, 0, 2, 3)
UVS = struct.pack("<8f", 0, 1, 1, 1, 1, 0, 0, 0)
QUAD_OBJ = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl grey\nf 1 2 3 4\n"


async def refused(folder, scene, *words, memory_mb=MEMORY_MB):
    """relight-render and relightd refuse the scene with a message that holds the words; returns it."""
    said = ""
    for program, more in (("relight-render", ("--out", folder / "out.exr")), ("relightd", ("--port", "0"))):
        begun = time.monotonic()
        ended = await Program(program, "--size", "16x9", "--samples", "1", "--scene", scene, "--max-scene-memory", memory_mb,
                              "--source", SMALL_SKY, *more).start()
        try:
            await ended.end()
        except asyncio.TimeoutError:
            await ended.kill()
            raise Failed(f"{program}: did not end") from None
        check(ended.code == 1, f"{program}: ended with {ended.code} after {time.monotonic() - begun:.1f} s: {ended.err[-400:]}")
        lines = [line for line in ended.err.splitlines() if "error: " in line]
        check(len(lines) == 1, f"{program}: not one line: {ended.err[-400:]}")
        said = lines[0].split("error: ", 1)[1].replace(str(folder) + "/", "")
        check(all(word in said for word in words), f"{program}: not {words} but: {said}")
    return said


async def grey(scene, *words):
    """relight-render renders the scene and warns of a texture with the words."""
    ended = await Program("relight-render", "--size", "16x9", "--samples", "1", "--scene", scene, "--max-scene-memory",
                          MEMORY_MB, "--source", SMALL_SKY, "--out", scene.with_suffix(".exr")).start()
    await ended.end()
    check(ended.code == 0, f"ended with {ended.code}: {ended.err[-400:]}")
    said = [line.split("warning: ", 1)[1] for line in ended.err.splitlines() if "grey" in line]
    check(len(said) == 1 and all(word in said[0] for word in words), f"not one line with {words}: {ended.err[-400:]}")
    return said[0].replace(str(scene.parent) + "/", "")


async def shown(scene):
    async with Relightd("--scene", str(scene), source=SMALL_SKY) as server, Viewer(server) as viewer:
        await viewer.sees(2)


def write_json(folder, models, name="scene.json"):
    text = json.dumps({"camera": CAMERA, "models": models, "materials": GREY})
    (folder / name).write_text(text, encoding="ascii")
    return folder / name


def gltf(**more):
    """A square, as the parts of a .gltf file; `more` replaces some."""
    return {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"uri": "square.bin", "byteLength": len(SQUARE) + len(UVS)}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12},
                        {"buffer": 0, "byteOffset": 60, "byteLength": 32}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
                      {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
                      {"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2"}],
        **more}


def write_gltf(folder, parts, name="scene.gltf"):
    (folder / "square.bin").write_bytes(SQUARE + UVS)
    (folder / name).write_text(parts if isinstance(parts, str) else json.dumps(parts), encoding="ascii")
    return folder / name


def textured(*uris):
    return gltf(meshes=[{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1, "material": 0}]}],
                materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": i}}} for i in range(len(uris))],
                textures=[{"source": i} for i in range(len(uris))], images=[{"uri": uri} for uri in uris])


def png(width, height, rows):
    """Eight bits of grey; the image data are deflated as they come."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    squeeze = zlib.compressobj(9)
    data = b"".join([squeeze.compress(row) for row in rows] + [squeeze.flush()])
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)) +
            chunk(b"IDAT", data) + chunk(b"IEND", b""))


@row(alone=True)
async def G160_deeply_nested_nodes(folder):
    count = 200000
    nodes = [{"children": [i + 1]} for i in range(count - 1)] + [{"mesh": 0}]
    said = await refused(folder, write_gltf(folder, gltf(nodes=nodes)), "scene.gltf", "nodes nested deeper than 256")
    nodes[-1] = {"mesh": 0, "children": [0]}
    await refused(folder, write_gltf(folder, gltf(nodes=nodes)), "scene.gltf", "their own descendants")
    await shown(write_gltf(folder, gltf(nodes=nodes[:200] + [{"mesh": 0}])))
    return f"{count} nodes: {said}; 200 are taken"


@row(alone=True)
async def G161_deeply_nested_json(folder):
    text = json.dumps(gltf())[:-1] + ',"extras":' + "[" * 1000000 + "]" * 1000000 + "}"
    said = await refused(folder, write_gltf(folder, text), "scene.gltf", "JSON nested deeper than 256")
    body = text.encode()
    (folder / "scene.glb").write_bytes(struct.pack("<4sIIII", b"glTF", 2, 20 + len(body), len(body), 0x4e4f534a) + body)
    await refused(folder, folder / "scene.glb", "scene.glb", "JSON nested deeper than 256")
    (folder / "scene.json").write_text('{"models":' + "[" * 1000000, encoding="ascii")
    await refused(folder, folder / "scene.json", "scene.json", "depth")
    return f"a million brackets: {said}"


@row(alone=True)
async def G162_bombs_of_triangles(folder):
    """A few hundred bytes that stand for 4 * 10^9 indices, for a mesh 2^200 times, and for 500 meshes of 180,000 triangles."""
    if SANITIZED:
        skip("a sanitizer's shadow memory exceeds any limit")
    parts = gltf()
    parts["accessors"][1] = {"componentType": 5125, "count": 4000000000, "type": "SCALAR"}
    await refused(folder, write_gltf(folder, parts), "scene.gltf")
    nodes = [{"children": [i + 1, i + 1]} for i in range(200)] + [{"mesh": 0}]
    twice = await refused(folder, write_gltf(folder, gltf(nodes=nodes)), "scene.gltf", "several parents")
    parts = gltf(nodes=[{"children": list(range(1, 501))}] + [{"mesh": i} for i in range(500)])
    parts["meshes"] *= 500
    side = 300
    points = b"".join(struct.pack("<3f", i % side, i // side, 0) for i in range(side * side))
    faces = b"".join(struct.pack("<6I", i, i + 1, i + side, i + 1, i + side + 1, i + side)
                     for i in range(side * (side - 1)) if i % side < side - 1)
    (folder / "grid.bin").write_bytes(points + faces)
    parts["buffers"] = [{"uri": "grid.bin", "byteLength": len(points + faces)}]
    parts["bufferViews"] = [{"buffer": 0, "byteOffset": 0, "byteLength": len(points)},
                            {"buffer": 0, "byteOffset": len(points), "byteLength": len(faces)}]
    parts["accessors"] = [{"bufferView": 0, "componentType": 5126, "count": side * side, "type": "VEC3", "min": [0, 0, 0],
                           "max": [side, side, 0]},
                          {"bufferView": 1, "componentType": 5125, "count": len(faces) // 4, "type": "SCALAR"}]
    often = await refused(folder, write_gltf(folder, parts), "scene.gltf", "needs more than 0.2 GB", "--max-scene-memory", memory_mb=200)
    return f"{twice}; {often}"


@row(alone=True)
async def G163_a_face_with_very_many_corners(folder):
    count = 200000
    lines = [f"v {i % 447} {i // 447} {i % 2}" for i in range(count)]
    (folder / "face.obj").write_text("\n".join(lines) + "\nusemtl grey\nf " + " ".join(str(i + 1) for i in range(count)) + "\n",
                                     encoding="ascii")
    said = await refused(folder, write_json(folder, [{"file": "face.obj"}]), "face.obj", f"{count} corners, more than")
    (folder / "face.ply").write_text(f"ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\n"
                                     "property float z\nelement face 1\nproperty list int int vertex_indices\nend_header\n"
                                     + "\n".join(line[2:] for line in lines) + f"\n{count} "
                                     + " ".join(str(i) for i in range(count)) + "\n", encoding="ascii")
    await refused(folder, write_json(folder, [{"file": "face.ply", "material": "grey"}]), "face.ply", "corners, more than")
    return said


@row(alone=True)
async def G164_a_fifo_as_a_model(folder):
    os.mkfifo(folder / "pipe.obj")
    said = await refused(folder, write_json(folder, [{"file": "pipe.obj"}]), "pipe.obj: is a FIFO, not a file")
    os.mkfifo(folder / "pipe.json")
    await refused(folder, folder / "pipe.json", "pipe.json: is a FIFO, not a file")
    os.mkfifo(folder / "pipe.png")
    await grey(write_gltf(folder, textured("pipe.png")), "pipe.png: is a FIFO, not a file")
    os.mkfifo(folder / "pipe.bin")
    parts = gltf()
    parts["buffers"][0]["uri"] = "pipe.bin"
    await refused(folder, write_gltf(folder, parts), "pipe.bin: is a FIFO, not a file")
    os.mkfifo(folder / "pipe.mtl")
    (folder / "quad.obj").write_text("mtllib pipe.mtl\n" + QUAD_OBJ, encoding="ascii")
    await shown(write_json(folder, [{"file": "quad.obj"}]))
    return f"{said}; an OBJ's material file that is one is left out"


@row(alone=True)
async def G165_a_folder_as_a_model(folder):
    (folder / "inner.obj").mkdir()
    said = await refused(folder, write_json(folder, [{"file": "inner.obj"}]), "inner.obj: is a folder, not a file")
    (folder / "inner.glb").mkdir()
    await refused(folder, folder / "inner.glb", "inner.glb: is a folder, not a file")
    (folder / "device.obj").symlink_to("/dev/zero")
    await refused(folder, write_json(folder, [{"file": "device.obj"}]), "device.obj: is a device, not a file")
    return said


@row(alone=True)
async def G166_an_empty_file(folder):
    for name in ("none.obj", "none.ply", "none.glb", "none.gltf"):
        (folder / name).touch()
        said = await refused(folder, write_json(folder, [{"file": name}]), f"{name}: is empty")
    for name in ("none.glb", "none.gltf"):
        await refused(folder, folder / name, f"{name}: is empty")
    (folder / "none.json").touch()
    await refused(folder, folder / "none.json", "none.json: line 1")
    return said


@row(alone=True)
async def G167_a_truncated_glb(folder):
    parts = gltf()
    del parts["buffers"][0]["uri"]
    text = json.dumps(parts).encode()
    text += b" " * (-len(text) % 4)
    body = SQUARE + UVS
    whole = (struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(body), len(text), 0x4e4f534a) + text +
             struct.pack("<II", len(body), 0x4e4942) + body)
    (folder / "whole.glb").write_bytes(whole)
    await shown(folder / "whole.glb")
    said = set()
    for cut in sorted({1, 4, 11, 19, 20, 21, len(text) // 2, len(text) + 19, len(text) + 20, len(text) + 25, len(text) + 28,
                       len(whole) - 40, len(whole) - 1}):
        (folder / "cut.glb").write_bytes(whole[:cut])
        said.add((await refused(folder, folder / "cut.glb", "cut.glb"))[9:25])
    return f"13 lengths refused: {', '.join(sorted(said))}"


@row(alone=True)
async def G168_an_image_bomb_as_a_texture(folder):
    """65 KB for 64 million texels: 0.36 GB in memory, twice; and more texels than are allowed at all."""
    if SANITIZED:
        skip("a sanitizer's shadow memory exceeds any limit")
    (folder / "bomb.png").write_bytes(png(8192, 8192, [bytes(8193)] * 8192))
    size = (folder / "bomb.png").stat().st_size
    (folder / "other.png").write_bytes((folder / "bomb.png").read_bytes())
    said = await refused(folder, write_gltf(folder, textured("bomb.png", "other.png")), "needs more than 0.6 GB")
    (folder / "bomb.png").write_bytes(png(16384, 16384, [bytes(16385)] * 16384))
    await grey(write_gltf(folder, textured("bomb.png")), "bomb.png: 16384 x 16384 texels")
    return f"{size} bytes: {said}"


@row(alone=True)
async def G169_files_outside_of_the_scene(folder):
    """A model names neither files above its folder nor, by a link, elsewhere; the scene file names models anywhere."""
    (folder / "inner").mkdir()
    (folder / "secret.png").write_bytes(png(2, 2, [bytes(3)] * 2))
    (folder / "inner" / "link.png").symlink_to("../secret.png")
    outside = "is outside of the folders of the scene and its models"
    for uri in ("../secret.png", str(folder / "secret.png"), "link.png", "../inner/../secret.png"):
        said = await grey(write_gltf(folder / "inner", textured(uri)), f"secret.png: {outside}"
                          if "link" not in uri else f"link.png: {outside}")
        parts = gltf()
        parts["buffers"][0]["uri"] = uri
        await refused(folder, write_gltf(folder / "inner", parts), outside)
    (folder / "scenes").mkdir()
    await refused(folder, write_json(folder / "scenes", [{"file": "../inner/scene.gltf"}]), outside)
    (folder / "inner" / "link.png").unlink()
    (folder / "inner" / "link.png").write_bytes((folder / "secret.png").read_bytes())
    write_gltf(folder / "inner", textured("link.png"))
    await shown(write_json(folder / "scenes", [{"file": "../inner/scene.gltf"}]))
    await shown(write_json(folder, [{"file": "inner/scene.gltf"}]))
    return said


if __name__ == "__main__":
    main()
