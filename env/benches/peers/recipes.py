"""Whole steps as one would write them in Python, and as the released NextBestPath code takes them.

Both take four frames by Open3D, keep 5 % of their pixels, count coverage and make the network's input; neither keeps what it
computed for the step before, but for the cloud. The second is written from a description of what the released code computes
(window of 40 m in 256 pixels, four layers, 0.5 m, `cdist` of the ground truth and twice as many points of the cloud, the
obstacle slice drawn by matplotlib), and never slower than need be: its network is left out, and so are its files.
"""

import io
import time

import matplotlib
import numpy as np
import torch
from scipy.spatial import cKDTree

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.collections import LineCollection  # noqa: E402
from PIL import Image  # noqa: E402

SIDE, METRES, LAYERS, BOTTOM, TOP, EPSILON = 256, 40.0, 4, -0.5, 3.5, 0.5
CAMERA_HEIGHT = 1.65


class Recipe:
    """A cloud that grows; `parts` adds up the seconds of each part."""

    def __init__(self, house, camera):
        self.house, self.camera, self.rng = house, camera, np.random.default_rng(1)
        self.cloud, self.positions, self.parts = np.empty((0, 3), np.float32), [], {}

    def look(self, frame, pose):
        """The points of a random 5 % of a frame's pixels."""
        depth = frame(pose)
        rows, cols = np.nonzero(depth)
        chosen = self.rng.choice(len(rows), len(rows) // 20, replace=False)
        rows, cols = rows[chosen], cols[chosen]
        return pose[:3] + depth[rows, cols, None] * self.house.directions(pose, (rows, cols))

    def add(self, frame, poses):
        self.new = np.concatenate([self.look(frame, pose) for pose in poses])
        self.cloud = np.concatenate([self.cloud, self.new])
        self.positions += [pose[:3] for pose in poses]

    def pass_by(self, frame, poses):
        """A step on the way to those that are measured."""
        self.add(frame, poses)

    def step(self, poses):
        """Seconds for a step."""
        here, begun = poses[-1][:3], time.process_time()
        self.part("frames", lambda: self.add(self.camera.frame, poses))
        self.part("coverage", self.coverage)
        self.part("input", lambda: self.images(here))
        self.part("obstacles", lambda: self.obstacles(here))
        return time.process_time() - begun

    def part(self, name, work):
        begun = time.process_time()
        work()
        self.parts[name] = self.parts.get(name, 0.0) + time.process_time() - begun

    def obstacles(self, here):
        """Once for a map is enough."""


class KdTree(Recipe):
    """numpy and scipy; coverage asks a tree of the whole cloud."""

    name = "kd-tree of the cloud"

    def coverage(self):
        near, _ = cKDTree(self.cloud).query(self.house.surface, distance_upper_bound=EPSILON)
        return np.isfinite(near).mean()

    def images(self, here):
        pixel = METRES / SIDE
        def image(points, count, layer):
            floor = lambda points: np.floor(points[..., [2, 0]] / pixel).astype(int)
            cells = SIDE // 2 + floor(here) - floor(points)
            kept = ((cells >= 0) & (cells < SIDE)).all(1) & (layer >= 0) & (layer < count)
            flat = (layer[kept] * SIDE + cells[kept, 0]) * SIDE + cells[kept, 1]
            return np.bincount(flat, minlength=count * SIDE * SIDE).reshape(count, SIDE, SIDE)
        heights = (self.cloud[:, 1] - (here[1] - CAMERA_HEIGHT) - BOTTOM) / (TOP - BOTTOM)
        layers = image(self.cloud, LAYERS, np.floor(heights * LAYERS).astype(int))
        visits = np.array(self.positions)
        return np.concatenate([layers, image(visits, 1, np.zeros(len(visits), int))])


class KdTreeOfTheStep(KdTree):
    """The same, but the points not yet covered ask a tree of this step's points only."""

    name = "kd-tree of the step"

    def __init__(self, house, camera):
        super().__init__(house, camera)
        self.open = house.surface

    def pass_by(self, frame, poses):
        self.add(frame, poses)
        self.coverage()

    def coverage(self):
        near, _ = cKDTree(self.new).query(self.open, distance_upper_bound=EPSILON)
        self.open = self.open[~np.isfinite(near)]
        return 1 - len(self.open) / len(self.house.surface)


class Released(Recipe):
    """torch on the CPU and matplotlib."""

    name = "released recipe"

    def coverage(self):
        truth = torch.from_numpy(self.house.surface)
        cloud = torch.from_numpy(self.cloud)
        cloud = cloud[torch.randperm(len(cloud))[: 2 * len(truth)]]
        near = torch.cat([torch.cdist(some, cloud).min(1).values < EPSILON for some in truth.split(2000)])
        return near.float().mean().item()

    def images(self, here):
        cloud, centre = torch.from_numpy(self.cloud), torch.from_numpy(here)
        def image(points):
            cells = torch.round((METRES / 2 - (points - centre)[:, [2, 0]]) * SIDE / METRES).long()
            cells = cells[((cells >= 0) & (cells < SIDE)).all(1)]
            counts = torch.bincount(cells[:, 0] * SIDE + cells[:, 1], minlength=SIDE * SIDE)
            return counts.reshape(SIDE, SIDE).float()
        low, high = float(self.house.vertices[:, 1].min()), float(self.house.vertices[:, 1].max())
        edges = torch.linspace(low + 0.25, high - 0.25, LAYERS + 1)[:-1]
        layer = torch.bucketize(cloud[:, 1].contiguous(), edges) - 1
        layers = [image(cloud[layer == n]) for n in range(LAYERS)]
        # What overrules the predicted obstacles: all points, and those within 5 cm of the camera plane.
        layers += [image(torch.from_numpy(np.array(self.positions))), image(cloud)]
        return torch.stack(layers + [image(cloud[(cloud[:, 1] - centre[1]).abs() < 0.05])])

    def obstacles(self, here):
        corners = self.house.vertices[self.house.triangles]
        above = corners[..., 1] > here[1]
        corners, above = corners[(above.any(1)) & (~above.all(1))], above[(above.any(1)) & (~above.all(1))]
        ends = []
        for a, b in [(0, 1), (1, 2), (2, 0)]:
            p, q = corners[:, a], corners[:, b]
            with np.errstate(divide="ignore", invalid="ignore"):
                at = p + ((here[1] - p[:, 1]) / (q[:, 1] - p[:, 1]))[:, None] * (q - p)
            ends.append(np.where((above[:, a] != above[:, b])[:, None], at[:, [0, 2]], np.nan))
        ends = np.stack(ends, 1)
        segments = ends[~np.isnan(ends).any(2)].reshape(-1, 2, 2)
        figure, axes = plt.subplots(figsize=(2.56, 2.56), dpi=100)
        axes.add_collection(LineCollection(segments, colors="black", linewidths=1.5))
        axes.set_xlim(here[0] - METRES / 2, here[0] + METRES / 2)
        axes.set_ylim(here[2] - METRES / 2, here[2] + METRES / 2)
        axes.axis("off")
        file = io.BytesIO()
        figure.savefig(file, format="png", bbox_inches="tight", pad_inches=0)
        plt.close(figure)
        image = Image.open(file).convert("L").resize((SIDE, SIDE))
        return np.fliplr(np.asarray(image)) < 128
