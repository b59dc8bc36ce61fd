"""Reference tensors for `cargo test -p model --test golden`, made with PyTorch.

An independent definition of the network: nothing here knows the Rust code, and nothing is copied from the released
code, of which only the names of the state dict are used. Weights, inputs and labels come from a formula (`noise`) that
the Rust test computes too, so only answers are stored.

    pip install torch numpy safetensors          # made with torch 2.9.1, numpy 2.x, CPU
    python make.py                               # writes b4.safetensors, b16.safetensors, released_b2.pth, curve_b4.json beside itself
    python make.py --check DIR                   # loads a checkpoint of ours into PyTorch, strictly
"""

import json
import sys
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from safetensors.torch import load_file, save_file
from torch import nn

HERE = Path(__file__).parent


def noise(name, count):
    """`count` numbers in [-1, 1): 24 bits of SplitMix64 over an FNV-1a hash of the name."""
    key = 0xCBF29CE484222325
    for byte in name.encode():
        key = ((key ^ byte) * 0x100000001B3) % 2**64
    with np.errstate(over="ignore"):
        x = np.uint64(key) + np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        x = x ^ (x >> np.uint64(31))
    return (x >> np.uint64(40)).astype(np.float64) / 2**23 - 1.0


def unit(kernel, cin, cout):
    return nn.Conv2d(cin, cout, kernel, padding=kernel // 2), nn.BatchNorm2d(cout)


class Part(nn.Module):
    """A module that only holds named children, so that their keys come out right."""

    def __init__(self, **children):
        super().__init__()
        for name, child in children.items():
            self.add_module(name, child)


def double(cin, cout):
    return nn.Sequential(*unit(3, cin, cout), nn.ReLU(), *unit(3, cout, cout), nn.ReLU())


def doubled_size(cin, cout):
    return nn.Sequential(nn.Upsample(scale_factor=2), *unit(3, cin, cout), nn.ReLU())


class Reference(nn.Module):
    def __init__(self, base, inputs=5, headings=8):
        super().__init__()
        widths = [inputs] + [base * 2**i for i in range(5)]
        for level in range(1, 6):
            self.add_module(f"Conv{level}", Part(conv=double(widths[level - 1], widths[level])))
        for decoder, levels in ((1, (5, 4)), (2, (5, 4, 3, 2))):
            for level in levels:
                c = widths[level - 1]
                gate = Part(
                    W_g=nn.Sequential(*unit(1, c, c // 2)),
                    W_x=nn.Sequential(*unit(1, c, c // 2)),
                    psi=nn.Sequential(*unit(1, c // 2, 1), nn.Sigmoid()),
                )
                self.add_module(f"Up{level}_{decoder}", Part(up=doubled_size(2 * c, c)))
                self.add_module(f"Att{level}_{decoder}", gate)
                self.add_module(f"Up_conv{level}_{decoder}", Part(conv=double(2 * c, c)))
        self.Final1 = nn.Conv2d(4 * base, headings, 1)
        self.Final2 = nn.Sequential(nn.Conv2d(base, 1, 1), nn.Sigmoid())
        self.log_vars = nn.Parameter(torch.zeros(2))

    def forward(self, x):
        skips = []
        for level in range(1, 6):
            x = getattr(self, f"Conv{level}").conv(x if level == 1 else F.max_pool2d(x, 2))
            skips.append(x)
        answers = []
        for decoder, levels in ((1, (5, 4)), (2, (5, 4, 3, 2))):
            d = skips[-1]
            for level in levels:
                d = getattr(self, f"Up{level}_{decoder}").up(d)
                gate, skip = getattr(self, f"Att{level}_{decoder}"), skips[level - 2]
                skip = skip * gate.psi(F.relu(gate.W_g(d) + gate.W_x(skip)))
                d = getattr(self, f"Up_conv{level}_{decoder}").conv(torch.cat([skip, d], 1))
            answers.append(getattr(self, f"Final{decoder}")(d))
        return answers


def fill(net):
    """Weights from the formula, at scales that keep signals alive through the depth."""
    state = net.state_dict()
    for name, tensor in state.items():
        if name.endswith("num_batches_tracked"):
            continue
        u = noise(name, tensor.numel()).reshape(tensor.shape)
        if tensor.dim() == 4:
            u = u * np.sqrt(6.0 / np.prod(tensor.shape[1:]))
        elif name.endswith("running_mean"):
            u = u * 0.5
        elif name.endswith("running_var"):
            u = 1.0 + 0.5 * u
        elif ".weight" in name:
            u = 1.0 + 0.3 * u
        else:
            u = u * 0.2
        state[name] = torch.from_numpy(u.astype(np.float32))
    net.load_state_dict(state)
    return net


def formula_batch(batch, side):
    cells = side // 4
    counts = np.maximum(noise("input", batch * 5 * side * side) * 12 - 4, 0).astype(np.int64)
    x = torch.from_numpy(counts.astype(np.float64)).reshape(batch, 5, side, side)
    wall = torch.from_numpy((noise("wall", batch * side * side) > 0.6).astype(np.float64)).reshape(batch, 1, side, side)
    mask = torch.from_numpy(noise("mask", batch * 8 * cells * cells) > 0.9).reshape(batch, 8, cells, cells)
    gain = torch.from_numpy(5 + 5 * noise("gain", mask.numel())).reshape(mask.shape)
    return x, wall, mask, gain


def loss(net, value, obstacle, wall, mask, gain):
    mse, bce = F.mse_loss(value[mask], gain[mask]), F.binary_cross_entropy(obstacle, wall)
    sigma = torch.exp(net.log_vars)
    total = mse / (2 * sigma[0] ** 2) + torch.log(sigma[0]) + bce / sigma[1] ** 2 + torch.log(sigma[1])
    return total, mse, bce, *sigma


def make(base, batch, side):
    net = fill(Reference(base)).double()  # the truth to compare f32 with
    x, wall, mask, gain = formula_batch(batch, side)

    out = {}
    net.eval()
    with torch.no_grad():
        out["eval.value"], out["eval.obstacle"] = net(x)
    net.train()
    value, obstacle = net(x)
    total, *parts = loss(net, value, obstacle, wall, mask, gain)
    total.backward()
    out |= {"train.value": value.detach(), "train.obstacle": obstacle.detach()}
    out["train.loss"] = torch.stack([total, *parts]).detach()
    for name, parameter in net.named_parameters():
        if parameter.numel() <= 4096 and (".weight" in name or name == "log_vars"):
            out[f"grad.{name}"] = parameter.grad
    for name, buffer in net.named_buffers():
        if name.startswith(("Conv1.", "Conv5.conv.1.")) and "num_batches" not in name:
            out[f"after.{name}"] = buffer
    save_file({k: v.float().contiguous() for k, v in out.items()}, HERE / f"b{base}.safetensors")


def curve(base, batch, side, steps, dtype):
    """Losses of the first steps of training, each before its step: AdamW as in the paper."""
    net = fill(Reference(base)).to(dtype)
    x, wall, mask, gain = (t.to(dtype) if t.is_floating_point() else t for t in formula_batch(batch, side))
    optimizer = torch.optim.AdamW(net.parameters(), lr=1e-3, betas=(0.9, 0.999), eps=1e-8, weight_decay=0.01)
    losses = []
    for _ in range(steps):
        optimizer.zero_grad()
        total, *_ = loss(net, *net(x), wall, mask, gain)
        total.backward()
        optimizer.step()
        losses.append(total.item())
    return losses


def released(base):
    """A file like the released ones: the state dict is one entry of several."""
    net = fill(Reference(base))
    moments = {0: {"step": torch.tensor(3.0), "exp_avg": torch.ones(4), "exp_avg_sq": torch.ones(4)}}
    optimizer = {"state": moments, "param_groups": [{"lr": 1e-3, "betas": (0.9, 0.999), "params": [0]}]}
    content = {"epoch": 3, "model_state_dict": net.state_dict(), "optimizer_state_dict": optimizer}
    torch.save(content, HERE / f"released_b{base}.pth")


def check(folder):
    config = json.loads((folder / "config.json").read_text())["net"]
    net = Reference(config["base"], config["in_channels"], config["headings"])
    print(net.load_state_dict(load_file(folder / "model.safetensors"), strict=True))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--check"]:
        check(Path(sys.argv[2]))
    else:
        assert sum(p.numel() for p in Reference(64).parameters()) == 49_964_669
        make(4, 2, 64)
        make(16, 2, 32)
        released(2)
        curves = {str(t)[6:]: curve(4, 3, 48, 20, t) for t in (torch.float64, torch.float32)}
        (HERE / "curve_b4.json").write_text(json.dumps(curves, indent=1) + "\n")
