"""Depth images by other programs, from the houses and poses that `cargo bench -p env -- --export` writes."""

import ctypes
import json
import subprocess
from pathlib import Path

import numpy as np
import open3d as o3d

NEAR = 1e-3
HERE = Path(__file__).resolve().parent


class Camera(ctypes.Structure):
    _fields_ = [("width", ctypes.c_int), ("height", ctypes.c_int), ("focal", ctypes.c_float),
                ("near", ctypes.c_float), ("range", ctypes.c_float)]


class House:
    """A mesh in metres, the camera, poses of nine numbers (position, forward, right), a walk of them, our own depths."""

    def __init__(self, folder, number):
        about = json.loads((folder / f"{number}.json").read_text())
        lines = (folder / f"{number}.obj").read_text().splitlines()
        rows = lambda kind, dtype: np.array([line.split()[1:] for line in lines if line.startswith(kind)], dtype)
        self.vertices = rows("v ", np.float32)
        self.triangles = rows("f ", np.uint32) - 1
        c = about["camera"]
        focal = c["width"] / 2 / np.tan(np.radians(c["hfov_degrees"]) / 2)
        self.camera = Camera(c["width"], c["height"], focal, NEAR, c["range"])
        pose = lambda p: np.array(p["position"] + p["forward"] + p["right"], np.float32)
        self.poses = [pose(p) for p in about["poses"]]
        self.walk = [[pose(p) for p in captures] for captures in about["walk"]]
        shape = (len(self.poses), c["height"], c["width"])
        self.depths = np.fromfile(folder / f"{number}.depth.f32", np.float32).reshape(shape)
        self.surface = np.fromfile(folder / f"{number}.surface.f32", np.float32).reshape(-1, 3)
        right = (np.arange(c["width"]) + 0.5 - c["width"] / 2) / focal
        down = (np.arange(c["height"]) + 0.5 - c["height"] / 2) / focal
        self.offsets = np.stack(np.meshgrid(right, down), -1).astype(np.float32)

    def directions(self, pose, pixels=...):
        """A ray for each pixel, 1 along the optical axis."""
        offsets = self.offsets[pixels]
        directions = pose[3:6] + offsets[..., :1] * pose[6:]
        directions[..., 1] -= offsets[..., 1]
        return directions


def build_embree(folder):
    """The C++ beside this file as a library."""
    library = folder / "embree.so"
    flags = ["-O3", "-march=native", "-shared", "-fPIC"]
    subprocess.run(["g++", *flags, HERE / "embree.cpp", "-lembree3", "-o", library], check=True)
    library = ctypes.CDLL(library)
    library.embree_open.restype = ctypes.c_void_p
    return library


class Embree:
    """Embree 3 from C++, as fast as it goes on one thread."""

    def __init__(self, library, house, packets):
        self.house, self.draw = house, library.embree_packets if packets else library.embree_single
        pointer = lambda array: array.ctypes.data_as(ctypes.c_void_p)
        sizes = ctypes.c_size_t(len(house.vertices)), ctypes.c_size_t(len(house.triangles))
        v, t = np.ascontiguousarray(house.vertices), np.ascontiguousarray(house.triangles)
        self.scene = ctypes.c_void_p(library.embree_open(pointer(v), sizes[0], pointer(t), sizes[1]))
        self.depth = np.empty(house.depths.shape[1:], np.float32)

    def frame(self, pose):
        pointer = lambda array: array.ctypes.data_as(ctypes.c_void_p)
        self.draw(self.scene, ctypes.byref(self.house.camera), pointer(pose), pointer(self.depth))
        return self.depth


class Open3d:
    """Open3D's RaycastingScene (Embree 4 from Python) on one thread."""

    def __init__(self, house):
        self.house, self.scene = house, o3d.t.geometry.RaycastingScene(nthreads=1)
        self.scene.add_triangles(o3d.core.Tensor(house.vertices), o3d.core.Tensor(house.triangles))
        self.rays = np.empty((*house.depths.shape[1:], 6), np.float32)

    def frame(self, pose):
        self.rays[..., :3] = pose[:3]
        self.rays[..., 3:] = self.house.directions(pose)
        depth = self.scene.cast_rays(o3d.core.Tensor.from_numpy(self.rays), nthreads=1)["t_hit"].numpy()
        depth[~((depth >= NEAR) & (depth < self.house.camera.range))] = 0.0
        return depth
