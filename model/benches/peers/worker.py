"""PyTorch's side of `measure.py`: one piece of work in a process of its own, with the questions and answers of
`cargo bench -p model -- --serve` (see `cargo bench -p model -- --help`).

    worker.py TASK ROW KIND FOLDER THREADS

KIND is f32, bf16 (autocast), compile or frozen (torch.compile, the latter with inductor's constant folding); FOLDER holds the
network that our bench exported.
"""

import statistics
import sys
import time
from pathlib import Path

import numpy as np
import torch
import torch._inductor.config
import torch.nn.functional as F
from safetensors.torch import load_file

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "golden"))
from make import Reference  # noqa: E402


def channels_last(images):
    return torch.from_numpy(images.astype(np.float32)).contiguous(memory_format=torch.channels_last)


def inputs(batch, side):
    """The counts of `work.rs`."""
    i = np.arange(batch * 5 * side * side, dtype=np.int64)
    counts = np.maximum(i * 7919 % 97 - 80, 0) * (i * 31 % 11)
    return channels_last(counts.reshape(batch, 5, side, side))


def labels(batch, side):
    """Gains, the cells that have one, and obstacles, as in `work.rs`."""
    size = side // 4
    i = np.arange(20)
    place = (slice(None), i % 8, i % size, i * 3 % size)
    sums, count = np.zeros((batch, 8, size, size)), np.zeros((batch, 8, size, size))
    for one in range(batch):
        np.add.at(sums[one], place[1:], i)
        np.add.at(count[one], place[1:], 1)
    wall = np.arange(batch * side * side) % 13 == 0
    gain = torch.from_numpy((sums / np.maximum(count, 1)).astype(np.float32))
    return gain, torch.from_numpy(count > 0), torch.from_numpy(wall.astype(np.float32)).reshape(batch, 1, side, side)


def prepare(task, row, kind, folder):
    """A function that does the work once and returns the loss, or the mean of all value maps plus that of all obstacle maps."""
    side, base, batch = map(int, row.split("/"))
    torch.manual_seed(0)
    net = Reference(base).to(memory_format=torch.channels_last)
    net.load_state_dict(load_file(Path(folder) / "model.safetensors"), strict=True)
    autocast = lambda: torch.autocast("cpu", dtype=torch.bfloat16, enabled=kind == "bf16")
    if task == "train":
        x, (gain, known, wall) = inputs(batch, side), labels(batch, side)
        # Of PyTorch's three implementations the fastest on a CPU.
        optimiser = torch.optim.AdamW(net.parameters(), lr=1e-3, fused=True)

        def train():
            optimiser.zero_grad(set_to_none=True)
            with autocast():
                value, obstacle = net(x)
            value, obstacle = value.float(), obstacle.float()
            mse, bce = F.mse_loss(value[known], gain[known]), F.binary_cross_entropy(obstacle, wall)
            sigma = torch.exp(net.log_vars)
            total = mse / (2 * sigma[0] ** 2) + torch.log(sigma[0]) + bce / sigma[1] ** 2 + torch.log(sigma[1])
            total.backward()
            optimiser.step()
            return total.item()

        return train

    x = inputs(1 if task == "decide" else batch, side)
    net.eval()
    if kind in ("compile", "frozen"):
        torch._inductor.config.freezing = kind == "frozen"
        net = torch.compile(net)

    def infer():
        with torch.no_grad(), autocast():
            value, obstacle = net(x)
        return value.float().mean().item() + obstacle.float().mean().item()

    return infer


def sgemm():
    """10⁹ operations a second of a product of two matrices, at best."""
    n = 1024
    a, b = torch.full((n, n), 0.5), torch.full((n, n), 0.25)
    times = []
    for _ in range(101):
        begun = time.perf_counter()
        a @ b
        times.append(time.perf_counter() - begun)
    return 2 * n**3 / min(times) / 1e9


def peak_memory():
    """MiB."""
    line = next(line for line in open("/proc/self/status") if line.startswith("VmHWM:"))
    return int(line.split()[1]) / 1024


def main():
    task, row, kind, folder, threads = sys.argv[1:]
    torch.set_num_threads(int(threads))
    step = prepare(task, row, kind, folder)
    for line in sys.stdin:
        question = line.strip()
        if question == "memory":
            print(peak_memory(), flush=True)
        elif question == "sgemm":
            print(sgemm(), flush=True)
        else:
            count = int(question)
            first, times, cpu = step(), [], time.process_time()
            for _ in range(count):
                begun = time.perf_counter()
                step()
                times.append(time.perf_counter() - begun)
            print(statistics.median(times), (time.process_time() - cpu) / count, first, flush=True)


if __name__ == "__main__":
    main()
