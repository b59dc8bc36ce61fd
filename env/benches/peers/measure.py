"""Our simulator beside Embree, Open3D and Python recipes: the same meshes and poses, one thread, in turns, in one run.

    apt install libembree-dev g++
    python3 -m venv /tmp/venv-peers && /tmp/venv-peers/bin/pip install -r env/benches/peers/requirements.txt
    /tmp/venv-peers/bin/python env/benches/peers/measure.py [--quick] [--out FILE]

prints tables in Markdown: medians, and how many times longer a peer takes. All times are those of the processor, ours and the
peers': on a busy machine long work is interrupted and short work is not, so the clock on the wall would flatter the faster.
"""

import os

for variable in ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"]:
    os.environ[variable] = "1"

import argparse  # noqa: E402
import subprocess  # noqa: E402
import tempfile  # noqa: E402
import time  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402
import open3d  # noqa: E402
import torch  # noqa: E402
from frames import HERE, Embree, House, Open3d, build_embree  # noqa: E402
from recipes import KdTree, KdTreeOfTheStep, Released  # noqa: E402

ROOT = HERE.parents[2]
BENCH = ["cargo", "bench", "--quiet", "-p", "env", "--"]
# The recipes' time grows with the cloud: they are measured in the middle of an episode of 100 steps.
MIDDLE = 50


class Ours:
    """The bench as a child that answers questions."""

    def __init__(self):
        pipe = subprocess.PIPE
        self.child = subprocess.Popen([*BENCH, "--answer"], cwd=ROOT, stdin=pipe, stdout=pipe, text=True)

    def ask(self, *question):
        print(*question, file=self.child.stdin, flush=True)
        return float(self.child.stdout.readline())


def seconds(work):
    begun = time.process_time()
    work()
    return time.process_time() - begun


def measure_frames(ours, number, house, peers, repeats):
    """Median milliseconds for a frame by each: over all poses, after a round of them that is not timed."""
    questions = {"ours": "frame", "obvhs, single rays": "obvhs", "watertight rays over obvhs": "rays"}
    times = {name: [] for name in [*questions, *peers]}
    for _ in range(repeats):
        for name, question in questions.items():
            times[name].append(ours.ask(question, number))
        for name, peer in peers.items():
            a_round = lambda: [peer.frame(pose) for pose in house.poses]
            a_round()
            times[name].append(1e3 * seconds(a_round) / len(house.poses))
    return {name: float(np.median(all)) for name, all in times.items()}


def compare_depths(house, peers):
    """Of each peer: pixels that differ from ours by more than 1 mm, and the largest difference of the others, in metres."""
    rows = {}
    for name, peer in peers.items():
        differences = np.array([np.abs(peer.frame(pose) - ours) for pose, ours in zip(house.poses, house.depths)])
        apart = differences > 1e-3
        rows[name] = int(apart.sum()), differences.size, float(differences[~apart].max())
    return rows


def measure_steps(ours, number, house, embree, camera, repeats):
    """Median milliseconds for a step by each, always the same step of the same walk, and of the recipes' parts."""
    recipes = {recipe.name: recipe(house, camera) for recipe in [KdTreeOfTheStep, KdTree, Released]}
    for recipe in recipes.values():
        # Up to the middle quickly: the frames by packets, and nothing that leaves no trace.
        for poses in house.walk[:MIDDLE]:
            recipe.pass_by(embree.frame, poses)
        here = recipe.positions[-1]
        for warm_up in [recipe.coverage, lambda: recipe.images(here), lambda: recipe.obstacles(here)]:
            warm_up()
    times = {name: [] for name in ["ours", *recipes]}
    for step in range(MIDDLE, MIDDLE + repeats):
        times["ours"].append(ours.ask("step", number, step))
        for name, recipe in recipes.items():
            times[name].append(1e3 * recipe.step(house.walk[step]))
    parts = {name: {part: 1e3 * t / repeats for part, t in recipe.parts.items()} for name, recipe in recipes.items()}
    return {name: float(np.median(all)) for name, all in times.items()}, parts


def table(title, houses, times):
    """Markdown: ours in milliseconds, each peer in milliseconds and as a multiple of it."""
    names = [name for name in times[0] if name != "ours"]
    lines = [f"| {title} | ours, ms | " + " | ".join(f"{name}, ms | ratio" for name in names) + " |"]
    lines.append("|---" * (2 + 2 * len(names)) + "|")
    for house, row in zip(houses, times):
        cells = " | ".join(f"{row[name]:.3g} | **{row[name] / row['ours']:,.3g}×**" for name in names)
        lines.append(f"| {len(house.triangles):,} triangles | {row['ours']:.3g} | {cells} |")
    return "\n".join(lines)


def machine(library):
    cpu = next(line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name"))
    git = ["git", "describe", "--always", "--dirty"]
    commit = subprocess.run(git, cwd=ROOT, capture_output=True, text=True).stdout.strip()
    native = "native" if library.embree_has_packets() else "split"
    return (f"{cpu}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; commit {commit}; Embree 3 ({native} packets of "
            f"16), Open3D {open3d.__version__}, torch {torch.__version__}; one thread each, in turns")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer repeats")
    parser.add_argument("--out", type=Path, help="also write the tables to this file")
    arguments = parser.parse_args()
    repeats, steps = (3, 1) if arguments.quick else (9, 5)
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        subprocess.run([*BENCH, "--export", folder], cwd=ROOT, check=True)
        library, ours = build_embree(folder), Ours()
        # Now, not at the end: the commit is the one that was built.
        about = machine(library)
        houses = [House(folder, number) for number in range(3)]
        frames, whole, checks, parts = [], [], [], []
        for number, house in enumerate(houses):
            packets, camera = Embree(library, house, True), Open3d(house)
            peers = {"Embree, single rays": Embree(library, house, False), "Embree, packets": packets, "Open3D": camera}
            checks.append(compare_depths(house, peers))
            frames.append(measure_frames(ours, number, house, peers, repeats))
            times, of_recipes = measure_steps(ours, number, house, packets, camera, steps)
            whole.append(times)
            parts.append(of_recipes)
    text = [about, "", table("frame of 456×256", houses, frames), "", table("whole step", houses, whole), ""]
    text += [f"The recipes at step {MIDDLE}, by parts, ms:", ""]
    for house, of_recipes in zip(houses, parts):
        for name, all in of_recipes.items():
            listed = ", ".join(f"{part} {time:.0f}" for part, time in all.items())
            text.append(f"- {len(house.triangles):,} triangles, {name}: {listed}")
    text += ["", "Depths beside ours:", ""]
    for house, rows in zip(houses, checks):
        for name, (apart, count, rest) in rows.items():
            text.append(f"- {len(house.triangles):,} triangles, {name}: {apart} of {count:,} pixels differ by more than "
                        f"1 mm, the others by at most {1e3 * rest:.3f} mm")
    print("\n".join(text))
    if arguments.out:
        arguments.out.write_text("\n".join(text) + "\n")


if __name__ == "__main__":
    main()
