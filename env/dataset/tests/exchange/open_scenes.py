"""Opens scene folders as other people's programs do: trimesh, Open3D, and the released loader's reading of settings.json.

    pip install -r requirements.txt
    python open_scenes.py DIR [DIR …]

Every folder with an OBJ file below a DIR must be one triangulated mesh with the same faces and bounds in both libraries, its
image on it where the MTL names one, and settings by whose formulas the released code stands on its start positions inside the
mesh. Prints a line for each scene; exit code 1 when one fails.
"""

import json
import sys
from pathlib import Path

import numpy as np
import open3d as o3d
import trimesh

RAYS = 64
# The released code: one of its units is 0.5 m, a lattice step 3 units, the camera 3.3 units above the floor, and it
# multiplies lengths by 10 unless its configuration says otherwise.
UNIT, STEP, HEIGHT, FACTOR = 0.5, 3.0, 3.3, 10.0
KEYS = {
    "scene": "grid_l grid_w grid_h cell_capacity cell_resolution x_min x_max",
    "camera": "x_min x_max pose_l pose_w pose_h pose_n_theta pose_n_azim start_positions contrast_factor",
}


class Wrong(Exception):
    """A sentence on what is wrong with a scene."""


def need(condition, sentence):
    if not condition:
        raise Wrong(sentence)


def written(obj):
    """Bounds and faces as they stand in the file."""
    vertices, corners = [], []
    for line in obj.read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(w) for w in words[1:4]])
        elif words[:1] == ["f"]:
            corners.append(len(words) - 1)
    vertices = np.array(vertices)
    need(len(vertices) and np.isfinite(vertices).all(), "vertices that are no finite numbers")
    return np.array([vertices.min(0), vertices.max(0)]), corners


def image_of(obj):
    """The image that the MTL names, or None."""
    libraries = [line.split(maxsplit=1)[1] for line in obj.read_text().splitlines() if line.startswith("mtllib ")]
    for library in libraries:
        path = obj.parent / library
        need(path.is_file(), f"{library} is missing")
        for line in path.read_text().splitlines():
            if line.strip().startswith("map_Kd "):
                image = obj.parent / line.split()[-1]
                need(image.is_file(), f"{image.name} is missing")
                return image
    return None


def same_bounds(found, bounds, who):
    found, size = np.array(found), np.abs(bounds).max()
    need(np.allclose(found, bounds, atol=1e-5 * size), f"{who} has bounds {found.tolist()}, the file {bounds.tolist()}")


def with_trimesh(obj, bounds, triangles, image):
    loaded = trimesh.load(obj, process=False)
    parts = list(loaded.geometry.values()) if isinstance(loaded, trimesh.Scene) else [loaded]
    need(len(parts) == 1, f"trimesh finds {len(parts)} meshes instead of one")
    mesh = parts[0]
    need(len(mesh.faces) == triangles, f"trimesh has {len(mesh.faces)} faces, the file {triangles}")
    same_bounds(mesh.bounds, bounds, "trimesh")
    if image is not None:
        need(mesh.visual.kind == "texture", f"trimesh sees {mesh.visual.kind} instead of a texture")
        material = mesh.visual.material
        picture = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
        need(picture is not None, "trimesh finds no image")
        uv = mesh.visual.uv
        need(len(uv) == len(mesh.vertices) and np.isfinite(uv).all(), "trimesh finds texture coordinates missing")
        need(uv.min() >= -1e-6 and uv.max() <= 1 + 1e-6, "texture coordinates beyond the image")
    # Joined by position: what geometry alone looks like.
    plain = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    edges = np.sort(plain.edges, axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return plain.is_watertight, (counts % 2 == 0).mean()


def with_open3d(obj, bounds, triangles, image):
    mesh = o3d.io.read_triangle_mesh(str(obj))
    need(len(mesh.triangles) == triangles, f"Open3D has {len(mesh.triangles)} triangles, the file {triangles}")
    same_bounds([mesh.get_min_bound(), mesh.get_max_bound()], bounds, "Open3D")
    if image is not None:
        need(mesh.has_triangle_uvs(), "Open3D finds no texture coordinates")
        need(any(not texture.is_empty() for texture in mesh.textures), "Open3D finds no image")
    return mesh


def shoot(scene, origins, directions):
    rays = np.concatenate([origins, directions], axis=1).astype(np.float32)
    return scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()


def by_the_released_loader(folder, mesh):
    """The loader's factor, and the share of rays from the start positions that meet nothing."""
    path = next((folder / name for name in ("settings.json", "setting.json") if (folder / name).is_file()), None)
    need(path is not None, "no settings.json")
    settings = json.loads(path.read_text())
    missing = [f"{part}.{key}" for part, keys in KEYS.items() for key in keys.split() if key not in settings[part]]
    need(not missing, f"settings.json lacks {', '.join(missing)}")
    scene, camera = settings["scene"], settings["camera"]
    factor = scene["metres_per_unit"] / UNIT if "metres_per_unit" in scene else FACTOR
    low, high = (np.array(scene[key]) * factor for key in ("x_min", "x_max"))
    need((low < high).all(), "scene.x_min is not below scene.x_max")
    vertices = np.asarray(mesh.vertices) * factor
    inside = ((vertices > low - 0.01) & (vertices < high + 0.01)).all(axis=1).mean()
    need(inside > 0.99, f"only {inside:.0%} of the vertices lie in the scene's box")
    need(camera["pose_n_azim"] == 8 and camera["pose_n_theta"] == 5, "not 8 azimuths and 5 elevations")
    first = np.array(camera["x_min"]) * factor
    last = first + STEP * np.array([camera["pose_l"] - 1, 0, camera["pose_h"] - 1])
    need((last[[0, 2]] < high[[0, 2]] + STEP).all(), "the lattice is larger than the scene")
    starts = camera["start_positions"]
    need(len(starts) >= 5, f"{len(starts)} start positions instead of five")
    origins = []
    for l, _, h, theta, azimuth in starts:
        need(0 <= l < camera["pose_l"] and 0 <= h < camera["pose_h"] and 0 <= azimuth < 8, "a start off the lattice")
        need(-90 + 180 * (1 + theta) / (camera["pose_n_theta"] + 1) == 0, "a start that does not look horizontally")
        origins.append(first + [STEP * l, HEIGHT, STEP * h])
    origins = np.array(origins)
    solid = o3d.t.geometry.RaycastingScene()
    solid.add_triangles(vertices.astype(np.float32), np.asarray(mesh.triangles).astype(np.uint32))
    below = shoot(solid, origins, np.tile([0.0, -1.0, 0.0], (len(origins), 1))) * UNIT
    need(np.isfinite(below).all(), "a start position without a floor below")
    need(below.max() < 12 and below.min() > 0.05, f"floors {below.tolist()} m below the start positions")
    n = np.arange(RAYS)
    y = (2 * n + 1) / RAYS - 1
    turn = np.pi * (3 - np.sqrt(5)) * n
    sphere = np.stack([np.sqrt(1 - y * y) * np.cos(turn), y, np.sqrt(1 - y * y) * np.sin(turn)], axis=1)
    hits = shoot(solid, np.repeat(origins, RAYS, axis=0), np.tile(sphere, (len(origins), 1)))
    escaping = (~np.isfinite(hits)).mean()
    # Files without a unit are published ones, which are open; so are scans.
    is_open = "metres_per_unit" not in scene or scene.get("open", False)
    need(is_open or escaping < 0.001, f"{escaping:.1%} of the rays from the starts escape")
    return factor, escaping


def open_scene(obj):
    bounds, corners = written(obj)
    image = image_of(obj)
    triangles = sum(n - 2 for n in corners)
    watertight, paired = with_trimesh(obj, bounds, triangles, image)
    mesh = with_open3d(obj, bounds, triangles, image)
    factor, escaping = by_the_released_loader(obj.parent, mesh)
    size = (bounds[1] - bounds[0]) * factor * UNIT
    return (
        f"{triangles} triangles{'' if max(corners) == 3 else ' (polygons in the file)'}, "
        f"{' x '.join(f'{s:.1f}' for s in size)} m, {image.name if image else 'no image'}, "
        f"{'watertight' if watertight else f'{paired:.1%} of edges paired'}, {escaping:.2%} of rays escape, "
        f"scene_scale_factor {factor:g}{' as released' if factor == FACTOR else ''}"
    )


def main(dirs):
    objs = sorted({obj for d in dirs for obj in Path(d).rglob("*.obj") if not obj.parent.name.startswith(".")})
    if not objs:
        sys.exit(f"no *.obj below {', '.join(dirs) or 'nothing'}")
    failed = 0
    for obj in objs:
        try:
            print(f"ok    {obj.parent.name}: {open_scene(obj)}", flush=True)
        except Wrong as wrong:
            failed += 1
            print(f"WRONG {obj.parent.name}: {wrong}", flush=True)
    print(f"{len(objs) - failed} of {len(objs)} scenes open as they should")
    sys.exit(failed > 0)


main(sys.argv[1:])
