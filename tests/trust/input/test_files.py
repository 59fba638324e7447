"""A scene reads only regular files of bounded size from its own folder."""

from __future__ import annotations

import cProfile
import io
import json
import os
import tracemalloc
import zipfile
from functools import partial

import numpy as np
import PIL.Image
import pytest

import irrsplat
from irrsplat.app import cli
from irrsplat.core import paths
from irrsplat.core.errors import InputError
from irrsplat.records import cache_file
from irrsplat.scene.io import images
from irrsplat.scene.io.images import read_images
from tests.support.gltf_files import POINTS, GltfFile, read_image
from tests.trust.fuzz import readers

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
SECRET = "alpha:beta:gamma delta:epsilon zeta\n"
TEXTURED = "vt 0 0\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/1 3/1\n"


def gltf(folder, images, name="a.gltf"):
    tree = readers.gltf_tree() | {"images": images, "textures": [{"source": i} for i in range(len(images))]}
    tree["nodes"] = [{"mesh": 0}]
    tree["scenes"], tree["animations"] = [{"nodes": [0]}], []
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": i}}} for i in range(len(images))]
    primitive = tree["meshes"][0]["primitives"][0]
    tree["meshes"][0]["primitives"] = [primitive | {"material": i} for i in range(len(images))]
    (folder / name).write_text(json.dumps(tree))
    return folder / name


def solid(folder, name, side, mode="1"):
    PIL.Image.new(mode, (side, side)).save(folder / name, optimize=True)
    return folder / name


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.parametrize("ending", [".scene", ".obj", ".ply", ".stl", ".glb", ".gltf"])
def test_a_pipe_is_refused_at_once(tmp_path, ending):
    os.mkfifo(tmp_path / f"a{ending}")
    with pytest.raises(InputError, match="no regular file"):
        irrsplat.load(tmp_path / f"a{ending}")
    with pytest.raises(InputError, match="no regular file"):
        cache_file.read(tmp_path / f"a{ending}", readers.cache_key())


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="needs /dev/zero")
def test_a_device_is_refused_in_an_allowed_folder(tmp_path):
    (tmp_path / "a.scene").write_text("obj /dev/zero\n")
    with pytest.raises(InputError, match="outside the scene's folder"):
        irrsplat.load(tmp_path / "a.scene")
    with pytest.raises(InputError, match="no regular file"):
        irrsplat.load(tmp_path / "a.scene", allow="/dev")


@pytest.mark.parametrize("text", ["obj {}", "light {}", "sky {}"])
def test_files_outside_the_folder_of_a_scene_are_refused(tmp_path, text):
    inside = tmp_path / "inside"
    inside.mkdir()
    for name in ("secret", "secret.light", "secret.hdr"):
        (tmp_path / name).write_text(SECRET)
        (inside / "link").unlink(missing_ok=True)
        (inside / "link").symlink_to(tmp_path / name)
        for written in (f"../{name}", str(tmp_path / name), "link"):
            (inside / "a.scene").write_text(text.format(written) + "\n")
            with pytest.raises(InputError, match="outside the scene's folder") as caught:
                irrsplat.load(inside / "a.scene")
            assert not [word for word in SECRET.split() if word in str(caught.value)]
    (inside / "a.scene").write_text(text.format("../there-is-none") + "\n")  # the message does not reveal its existence
    with pytest.raises(InputError, match="outside the scene's folder"):
        irrsplat.load(inside / "a.scene")


def test_allowed_folders_are_read(tmp_path, capsys):
    (tmp_path / "inside").mkdir()
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "t.obj").write_text(TRIANGLE)
    scene = tmp_path / "inside" / "a.scene"
    scene.write_text("obj ../parts/t.obj\n")
    assert irrsplat.load(scene, allow=[tmp_path / "parts"]).triangles == 1
    assert cli.main(["info", str(scene)]) == 2
    assert f"--allow '{tmp_path / 'parts'}'" in capsys.readouterr().err
    assert cli.main(["info", str(scene), "--allow", str(tmp_path / "parts")]) == 0
    assert cli.main(["info", str(scene), "--allow", str(tmp_path / "none")]) == 2
    assert "there is no folder" in capsys.readouterr().err


def test_materials_and_images_outside_are_skipped_with_a_notice(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "p.png").write_bytes(readers.png())
    (tmp_path / "m.mtl").write_text("newmtl a\nKd 1 0 0\n")
    for name, text in {
        "a.obj": "mtllib ../m.mtl\nusemtl a\n" + TRIANGLE,
        "b.obj": "mtllib b.mtl\nusemtl b\n" + TEXTURED,
        "b.mtl": "newmtl b\nmap_Kd ../p.png\n",
    }.items():
        (inside / name).write_text(text)
    found = [irrsplat.load(inside / "a.obj"), irrsplat.load(inside / "b.obj"), irrsplat.load(gltf(inside, [{"uri": "../p.png"}]))]
    for scene in found:
        assert any("outside the scene's folder" in notice for notice in scene.notices)
        assert not scene.meshes[0].material.textures and scene.meshes[0].material.albedo != (1.0, 0.0, 0.0)
    assert irrsplat.load(inside / "b.obj", allow=tmp_path).meshes[0].material.textures


def test_too_large_files_are_refused_unread(tmp_path):
    for name, most in (("a.scene", paths.MOST_TEXT), ("a.stl", paths.MOST_GEOMETRY), ("a.glb", paths.MOST_GEOMETRY)):
        with open(tmp_path / name, "wb") as file:
            file.truncate(most + 1)  # sparse: no disk space
        with pytest.raises(InputError, match=f"larger than {most >> 20} MiB"):
            irrsplat.load(tmp_path / name)
    (tmp_path / "a").write_bytes(b"x" * 1000)  # memory depends on the file's size, not on the limit for its kind
    tracemalloc.start()
    assert len(paths.read_bytes(tmp_path / "a", paths.MOST_GEOMETRY)) == 1000
    assert tracemalloc.get_traced_memory()[1] < 100_000
    tracemalloc.stop()


def test_an_image_of_few_bytes_and_many_pixels_is_not_decoded(tmp_path, monkeypatch):
    monkeypatch.setattr(images, "_rgba", lambda picture: pytest.fail("the image was decoded"))
    data = solid(tmp_path, "bomb.png", 12_000).read_bytes()
    assert len(data) < 30_000
    with pytest.raises(InputError, match=r"12000 × 12000 pixels in .* bytes"):
        read_image(data, "bomb.png")
    (found,) = read_images([(data, "bomb.png")])
    assert isinstance(found, InputError)
    scene = irrsplat.load(gltf(tmp_path, [{"uri": "bomb.png"}]))
    assert any("12000 × 12000 pixels" in notice for notice in scene.notices)
    with pytest.raises(InputError, match="no image of a known format"):  # PostScript is a program
        read_image(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\nshowpage\n%%EOF\n", "a.eps")


def test_the_limit_of_pixels_covers_all_images_of_a_scene(tmp_path, monkeypatch):
    monkeypatch.setattr(paths, "_Bounds", partial(paths._Bounds, pixels=3 * 64**2))
    monkeypatch.setattr(paths, "PIXELS_PER_BYTE", 0)
    for i in range(5):
        PIL.Image.new("RGB", (64, 64), (i, 0, 0)).save(tmp_path / f"{i}.png")
    scene = irrsplat.load(gltf(tmp_path, [{"uri": f"{i}.png"} for i in range(5)]))
    assert [bool(mesh.material.textures) for mesh in scene.meshes] == [True, True, True, False, False]


def test_the_limit_of_copies_covers_all_meshes_of_a_scene(tmp_path, monkeypatch):
    """Three copies of a triangle have nine vertices, the limit; a fourth copy by a line, a node or an instance is refused."""
    monkeypatch.setattr(paths, "_Bounds", partial(paths._Bounds, copies=9))
    (tmp_path / "t.obj").write_text(TRIANGLE)
    (tmp_path / "four.scene").write_text("obj t.obj\n" * 4)
    (tmp_path / "five.scene").write_text("obj t.obj\n" * 5)
    nodes, instances = GltfFile(), GltfFile()
    meshes = [file.mesh(indices=None, POSITION=POINTS[:3]) for file in (nodes, instances)]
    for _ in range(5):
        nodes.node(mesh=meshes[0])
    places = {"attributes": {"TRANSLATION": instances.accessor(np.zeros((5, 3), "f4"))}}
    instances.node(mesh=meshes[1], extensions={"EXT_mesh_gpu_instancing": places})
    some = irrsplat.load(nodes.gltf(tmp_path / "nodes.gltf"))
    assert some.triangles == irrsplat.load(tmp_path / "four.scene").triangles == 4
    assert any(paths.TOO_MANY_COPIES in notice for notice in some.notices)
    for path in (tmp_path / "five.scene", instances.gltf(tmp_path / "a.gltf")):
        with pytest.raises(InputError, match="meshes that are shown again have more than"):
            irrsplat.load(path)


def test_equal_images_are_stored_once(tmp_path):
    for i in range(20):
        (tmp_path / f"{i}.png").write_bytes(readers.png())
    scene = irrsplat.load(gltf(tmp_path, [{"uri": f"{i // 2}.png"} for i in range(40)]))
    assert len({id(mesh.material.textures[0].image) for mesh in scene.meshes}) == 1


def test_a_compressed_cache_is_refused(tmp_path):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as whole:
        header = io.BytesIO()
        np.lib.format.write_array(header, np.zeros(4_000_000, np.float32))
        whole.writestr("content.npy", header.getvalue())
    assert len(out.getvalue()) < 40_000
    (tmp_path / "a.cache").write_bytes(readers.cache_bytes(out.getvalue()))
    with pytest.raises(InputError, match="a damaged record cache"):
        cache_file.read(tmp_path / "a.cache", readers.cache_key())


def test_an_array_with_a_false_header_is_refused(tmp_path):
    data = readers.npz({**readers.cache_arrays(), "position": np.zeros((3, 4), "f4")})
    bad = data.replace(b"'shape': (3, 4), }    ", b"'shape': (3, 4000000000)")[: len(data)]
    assert bad != data
    late = readers.npz({**readers.cache_arrays(), "clocks": np.full(3, np.iinfo(np.int64).max)})  # full clocks cannot advance
    for payload in (bad, data.replace(b"<f4", b"|O8"), late):
        (tmp_path / "a.cache").write_bytes(readers.cache_bytes(payload))
        with pytest.raises(InputError, match="a damaged record cache"):
            cache_file.read(tmp_path / "a.cache", readers.cache_key())


def calls(path):
    """Return the number of function calls while a file is loaded."""
    profile = cProfile.Profile()
    profile.runcall(irrsplat.load, path)
    return sum(entry.callcount for entry in profile.getstats())


@pytest.mark.long
def test_the_work_of_loading_is_linear_in_materials(tmp_path):
    found = []
    (tmp_path / "a.mtl").write_text("".join(f"newmtl m{i}\nKd 0 0 {i / 2400}\n" for i in range(2400)))
    for count in (60, 600, 1200, 2400):  # the first load imports modules
        path = tmp_path / f"{count}.obj"
        path.write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n" + "".join(f"usemtl m{i}\nf 1 2 3\n" for i in range(count)))
        found.append(calls(path))
    assert found[3] - found[2] < 2.3 * (found[2] - found[1])
    found.clear()
    for count in (300, 1500, 2500):  # the first 1000 missing files are searched in other spellings: hundreds of calls each
        (tmp_path / "a.obj").write_text("".join(f"mtllib {i}.mtl\n" for i in range(count)) + TRIANGLE)
        assert len(irrsplat.load(tmp_path / "a.obj").notices) < 5
        found.append(calls(tmp_path / "a.obj"))
    assert found[2] - found[1] < 100 * 1000 < found[1] - found[0]
