"""Our network beside PyTorch's: the same weights, batches, loss and optimiser, the same number of threads, in turns.

    python3 -m venv /tmp/venv-torch && /tmp/venv-torch/bin/pip install -r model/benches/peers/requirements.txt
    /tmp/venv-torch/bin/python model/benches/peers/measure.py [ROW ...] [--tasks train,infer,decide] [--turns 7] [--out FILE]

prints tables in Markdown: medians on the clock (of the processor), and how many times longer PyTorch takes; memory is the most
that a process held. Rows are side/base/batch. `--without-compile` where there is no C++ compiler, which torch.compile needs
(`apt install g++`, or CXX=...).

Every piece of work is a process of its own, and PyTorch's are stopped while it is not their turn: OpenMP's threads go on spinning
for a while after their work; ours sleep. PyTorch's f32 runs twice, with this default and with OMP_WAIT_POLICY=passive; the faster counts.
"""

import argparse
import ctypes
import os
import platform
import signal
import statistics
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
BENCH = ["cargo", "bench", "--quiet", "-p", "model", "--"]
ROWS = ["128/16/8", "128/16/16", "128/32/8", "256/64/1"]
# One decision: paper's size and the CPU profile's.
COMPILED = ["128/16/1", "256/64/1"]
PEERS = {"f32": ("f32", {}), "passive": ("f32", {"OMP_WAIT_POLICY": "passive"}), "bf16": ("bf16", {})}
COMPILERS = {"compile": ("compile", {}), "frozen": ("frozen", {})}
# Seconds that a turn takes at least, the first untimed call aside.
TURN = 0.4


def die_with_parent():
    """A stopped process would outlive us."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)


class Worker:
    """A process that does one piece of work when asked, and if it `spins` is stopped when not."""

    def __init__(self, command, environment, spins):
        pipe = subprocess.PIPE
        self.child = subprocess.Popen(
            command, cwd=ROOT, env=os.environ | environment, stdin=pipe, stdout=pipe, text=True, preexec_fn=die_with_parent
        )
        self.spins = spins
        self.walls, self.cpus = [], []
        # The check of the first step, and that of the third: both sides must compute the same.
        warm_up = [self.ask(1), self.ask(1)]
        self.checks = [check for _, _, check in warm_up]
        self.calls = max(1, min(50, int(TURN / warm_up[1][0])))

    def ask(self, question):
        if self.spins:
            self.child.send_signal(signal.SIGCONT)
        print(question, file=self.child.stdin, flush=True)
        answer = self.child.stdout.readline().split()
        if self.spins:
            self.child.send_signal(signal.SIGSTOP)
        if not answer:
            raise RuntimeError(f"{self.child.args} broke off")
        return [float(word) for word in answer] if len(answer) > 1 else float(answer[0])

    def turn(self):
        wall, cpu, _ = self.ask(self.calls)
        self.walls.append(wall)
        self.cpus.append(cpu)

    def end(self):
        # Ours ends with its questions; cargo is between us.
        self.child.stdin.close()
        if self.spins:
            self.child.kill()
        self.child.wait()

    @property
    def wall(self):
        return statistics.median(self.walls)

    def cell(self):
        return f"{1e3 * self.wall:.4g} ({1e3 * statistics.median(self.cpus):.4g})"


class Bench:
    """Starts workers, ours and PyTorch's."""

    def __init__(self, folder, threads):
        self.folder, self.threads = folder, str(threads)

    def ours(self, task, row):
        return Worker([*BENCH, "--serve", task, row, "ours"], {"RAYON_NUM_THREADS": self.threads}, False)

    def peer(self, task, row, kind, environment):
        weights = self.folder / row.replace("/", "-")
        if not weights.exists():
            subprocess.run([*BENCH, "--export", row, weights], cwd=ROOT, check=True)
        command = [sys.executable, HERE / "worker.py", task, row, kind, weights, self.threads]
        threads = {name: self.threads for name in ["OMP_NUM_THREADS", "MKL_NUM_THREADS"]}
        return Worker(command, threads | environment, True)

    def measure(self, task, row, kinds, turns):
        """Workers by name after their turns, with their peak memory; they have ended."""
        workers = {"ours": self.ours(task, row)}
        try:
            for name, (kind, environment) in kinds.items():
                workers[name] = self.peer(task, row, kind, environment)
            compare(task, row, workers)
            order = list(workers.values())
            for turn in range(turns):
                # Whoever comes first finds the machine as the last one left it: everybody has their turn at that too.
                for place in range(len(order)):
                    order[(turn + place) % len(order)].turn()
            for worker in order:
                worker.memory = worker.ask("memory")
        finally:
            for worker in workers.values():
                worker.end()
        return workers


def compare(task, row, workers):
    """Both sides compute the same: inference to rounding, the loss at first to rounding and after two steps roughly."""
    ours = workers["ours"].checks
    for name, worker in workers.items():
        exact = 2e-2 if name == "bf16" else 1e-4
        bounds = (exact, 5e-2 if task == "train" else exact)
        for mine, theirs, bound in zip(ours, worker.checks, bounds):
            if not abs(mine - theirs) <= bound * abs(theirs):
                raise RuntimeError(f"{task} {row}: {name} computes {worker.checks}, we {ours}")


def train_table(bench, rows, turns):
    lines = ["| training step | ours, ms | samples/s | PyTorch f32, ms | passive waiting, ms | ratio | bf16 autocast, ms | ratio "
             "| ours, MiB | PyTorch, MiB | bf16, MiB |", "|---" * 11 + "|"]
    losses = []
    for row in rows:
        all = bench.measure("train", row, PEERS, turns)
        ours, batch = all["ours"], int(row.split("/")[2])
        lines.append(f"| {row} | {ours.cell()} | {batch / ours.wall:.3g} {compared(all)} |")
        losses.append(f"- {row}: " + "; ".join(f"{name} {w.checks[0]:.6g}, {w.checks[1]:.6g}" for name, w in all.items()))
    return [*lines, "", "Losses before the first and the third step:", "", *losses]


def infer_table(bench, rows, turns):
    lines = ["| forward | ours, ms | PyTorch f32, ms | passive waiting, ms | ratio | bf16 autocast, ms | ratio "
             "| ours, MiB | PyTorch, MiB | bf16, MiB |", "|---" * 10 + "|"]
    for row in rows:
        all = bench.measure("infer", row, PEERS, turns)
        lines.append(f"| {row} | {all['ours'].cell()} {compared(all)} |")
    return lines


def compared(all):
    """Cells of PyTorch's three kinds and of memory."""
    ours, f32, passive, bf16 = (all[name] for name in ["ours", *PEERS])
    best, memory = min(f32.wall, passive.wall), min(f32.memory, passive.memory)
    return (f"| {f32.cell()} | {passive.cell()} | **{best / ours.wall:.2f}×** | {bf16.cell()} | **{bf16.wall / ours.wall:.2f}×** "
            f"| {ours.memory:.0f} | {memory:.0f} ({ours.memory / memory:.2f}×) | {bf16.memory:.0f}")


def decide_table(bench, rows, turns, compile):
    kinds = PEERS | (COMPILERS if compile else {})
    names = {"f32": "eager", "passive": "passive waiting", "bf16": "bf16 autocast", "compile": "torch.compile",
             "frozen": "with freezing"}
    titles = " | ".join(f"{names[name]}, ms | ratio" for name in kinds)
    lines = [f"| one decision | ours, ms | {titles} |", "|---" * (2 + 2 * len(kinds)) + "|"]
    for row in rows:
        all = bench.measure("decide", row, kinds, turns)
        cells = [f"{all[name].cell()} | **{all[name].wall / all['ours'].wall:.2f}×**" for name in kinds]
        lines.append(f"| {row} | {all['ours'].cell()} | " + " | ".join(cells) + " |")
    return lines


def sgemm_line(bench, turns):
    """What the machine's processor can do at best, by both sides' libraries."""
    workers = {"gemm crate": bench.ours("decide", "128/16/1"), "torch.mm": bench.peer("decide", "128/16/1", *PEERS["passive"])}
    rates = {name: [] for name in workers}
    for _ in range(turns):
        for name, worker in workers.items():
            rates[name].append(worker.ask("sgemm"))
    for worker in workers.values():
        worker.end()
    rates = ", ".join(f"{name} {statistics.median(all):.0f}" for name, all in rates.items())
    return f"Matrix product of 1024³, GFLOP/s: {rates}."


def about(turns, threads):
    cpu = next(line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name"))
    git = ["git", "describe", "--always", "--dirty"]
    commit = subprocess.run(git, cwd=ROOT, capture_output=True, text=True).stdout.strip()
    return (f"{cpu}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start; commit {commit}; torch {version('torch')}, "
            f"Python {platform.python_version()}; {threads} threads each, {turns} turns; milliseconds on the clock (of the "
            "processor), medians; ratio: how many times longer PyTorch takes, of its f32 the faster policy")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", nargs="*", metavar="ROW", help=f"instead of {' '.join(ROWS)}, and of {' '.join(COMPILED)} for one decision")
    parser.add_argument("--tasks", default="train,infer,decide", help="which tables, with commas between")
    parser.add_argument("--turns", type=int, default=7)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--without-compile", action="store_true", help="leave torch.compile out")
    parser.add_argument("--out", type=Path, help="also write the tables to this file")
    arguments = parser.parse_args()
    turns, rows = arguments.turns, arguments.rows or ROWS
    text = []

    def say(*lines):
        print(*lines, sep="\n", flush=True)
        text.extend(lines)
        if arguments.out:
            arguments.out.write_text("\n".join(text) + "\n")

    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([*BENCH, "--help"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        # Now, not at the end: the commit is the one that was built.
        say(about(turns, arguments.threads))
        bench = Bench(Path(folder), arguments.threads)
        say("", sgemm_line(bench, turns), "")
        tables = {
            "train": lambda: train_table(bench, rows, turns),
            "infer": lambda: infer_table(bench, rows, turns),
            "decide": lambda: decide_table(bench, arguments.rows or COMPILED, turns, not arguments.without_compile),
        }
        for task in arguments.tasks.split(","):
            say(*tables[task](), "")


if __name__ == "__main__":
    main()
