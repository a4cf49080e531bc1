# Trains the depth network and writes it as ONNX.
"""Trains the depth network on pictures of `views.py` and writes it as ONNX.

The network takes `image` (1, 3, height, width), colours from 0 to 1 with sides that are multiples of 32, and gives
`closeness` (1, 1, height, width), from 0 for the background to 1 for the nearest surface. It is a U-Net with separable
convolutions in its deep levels. Training takes about an hour on two cores.
"""

import argparse
import copy
import pathlib
import time

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn

SIZES = [(224, 384), (224, 384), (256, 320), (288, 288), (352, 224)]
"""Heights and widths of training batches, so that the network meets pictures of several shapes."""


def convolution(inputs, outputs, side=3, stride=1, groups=1):
    return nn.Sequential(nn.Conv2d(inputs, outputs, side, stride, side // 2, groups=groups, bias=False),
                         nn.BatchNorm2d(outputs), nn.ReLU())


class Residual(nn.Module):
    """An inverted residual: widen, filter each channel, narrow, add."""

    def __init__(self, channels, widen=2, side=3):
        super().__init__()
        wide = channels * widen
        self.body = nn.Sequential(convolution(channels, wide, 1), convolution(wide, wide, side, groups=wide),
                                  nn.Conv2d(wide, channels, 1, bias=False), nn.BatchNorm2d(channels))

    def forward(self, x):
        return x + self.body(x)


class Up(nn.Module):
    """Doubles the size of deep features and joins them with those of the encoder at that size."""

    def __init__(self, deep, skip, outputs):
        super().__init__()
        self.narrow = convolution(deep, outputs, 1)
        self.skip = convolution(skip, outputs, 1)
        self.body = nn.Sequential(convolution(outputs, outputs, 3, groups=outputs), convolution(outputs, outputs, 1),
                                  Residual(outputs))

    def forward(self, deep, skip):
        deep = F.interpolate(self.narrow(deep), scale_factor=2.0, mode="bilinear", align_corners=False)
        return self.body(deep + self.skip(skip))


class DepthNetwork(nn.Module):
    def __init__(self):
        super().__init__()
        self.level_1 = convolution(3, 16, 3, 2)
        self.level_2 = nn.Sequential(convolution(16, 32, 3, 2), Residual(32))
        self.level_3 = nn.Sequential(convolution(32, 64, 3, 2), Residual(64), Residual(64))
        self.level_4 = nn.Sequential(convolution(64, 64, 3, 2, groups=64), convolution(64, 96, 1), Residual(96),
                                     Residual(96), Residual(96, side=5))
        self.level_5 = nn.Sequential(convolution(96, 96, 3, 2, groups=96), convolution(96, 128, 1), Residual(128),
                                     Residual(128, side=5))
        self.whole = nn.Linear(128, 128)
        self.up = nn.ModuleList([Up(128, 96, 96), Up(96, 64, 64), Up(64, 32, 32), Up(32, 16, 16)])
        self.out = nn.Conv2d(16, 1, 3, padding=1)

    def forward(self, image):
        half = self.level_1(image - 0.5)
        quarter = self.level_2(half)
        eighth = self.level_3(quarter)
        sixteenth = self.level_4(eighth)
        deep = self.level_5(sixteenth)
        deep = deep + self.whole(deep.mean((2, 3)))[:, :, None, None]
        for up, skip in zip(self.up, [sixteenth, eighth, quarter, half]):
            deep = up(deep, skip)
        return F.interpolate(torch.sigmoid(self.out(deep)), scale_factor=2.0, mode="bilinear", align_corners=False)


def augment(color, near, size, draw):
    """A random part of each picture at the given size, mirrored and recoloured at random."""
    count, _, height, width = color.shape
    shrink = torch.empty(count).uniform_(0.6, 1.15, generator=draw)
    aspect = (size[1] / size[0]) / (width / height)
    grid = torch.zeros(count, 2, 3)
    mirror = torch.where(torch.rand(count, generator=draw) < 0.5, -1.0, 1.0)
    share_x = shrink * min(1.0, aspect)
    share_y = shrink * min(1.0, 1 / aspect)
    grid[:, 0, 0] = share_x * mirror
    grid[:, 1, 1] = share_y
    grid[:, 0, 2] = (torch.rand(count, generator=draw) * 2 - 1) * (1 - share_x).clamp(min=0)
    grid[:, 1, 2] = (torch.rand(count, generator=draw) * 2 - 1) * (1 - share_y).clamp(min=0)
    at = F.affine_grid(grid, [count, 3, *size], align_corners=False)
    color = F.grid_sample(color, at, align_corners=False, padding_mode="border")
    near = F.grid_sample(near, at, align_corners=False, mode="nearest")
    gain = torch.empty(count, 3, 1, 1).uniform_(0.7, 1.3, generator=draw) * torch.empty(count, 1, 1, 1).uniform_(0.6, 1.2, generator=draw)
    gamma = torch.empty(count, 1, 1, 1).uniform_(0.7, 1.4, generator=draw)
    grey = color.mean(1, keepdim=True)
    fade = (torch.rand(count, 1, 1, 1, generator=draw) < 0.15) * torch.rand(count, 1, 1, 1, generator=draw)
    color = (color * (1 - fade) + grey * fade).clamp(0, 1) ** gamma * gain
    if torch.rand(1, generator=draw) < 0.4:
        first, last = torch.rand(2, count, 3, 1, 1, generator=draw)
        ramp = torch.linspace(0, 1, size[0])[None, None, :, None]
        color = torch.where(near > 0, color, first + (last - first) * ramp)
    color = color + torch.randn(color.shape, generator=draw) * 0.02 * torch.rand(count, 1, 1, 1, generator=draw)
    return color.clamp(0, 1), near


def loss_of(found, near):
    """Mean absolute error, and that of differences between neighbours at four scales."""
    error = found - near
    loss = error.abs().mean() * 2
    visible = (near > 0).float()
    loss = loss + 2 * (error.abs() * visible).sum() / visible.sum().clamp(min=1)
    for step in (1, 2, 4, 8):
        across = (error[..., step:] - error[..., :-step]).abs().mean()
        down = (error[..., step:, :] - error[..., :-step, :]).abs().mean()
        loss = loss + 0.5 * (across + down)
    return loss


def rank_correlation(found, truth):
    """Spearman's rank correlation, with mean ranks for ties."""
    def ranks(values):
        _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
        last = np.cumsum(counts)
        return (last - (counts - 1) / 2)[inverse]
    return np.corrcoef(ranks(found), ranks(truth))[0, 1]


@torch.no_grad()
def evaluate(network, held, shown=None):
    """Mean rank correlation over pictures: of all pixels, and of the visible ones."""
    network.eval()
    whole, visible = [], []
    for color, near in zip(held["color"][:shown], held["closeness"][:shown]):
        image = F.interpolate(torch.from_numpy(color).permute(2, 0, 1)[None].float() / 255, (224, 384), mode="bilinear")
        found = F.interpolate(network(image), near.shape, mode="bilinear")[0, 0].numpy()
        hit = near > 0
        whole.append(rank_correlation(np.round(found * 255), near))
        visible.append(rank_correlation(found[hit], near[hit]))
    network.train()
    return np.array(whole), np.array(visible)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=pathlib.Path, required=True, help="training pictures: .npz of views.py")
    parser.add_argument("--held-out", type=pathlib.Path, help="pictures of other volumes, whose correlation is printed")
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--minutes", type=float, default=600, help="shorten training so that it ends after this time")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=pathlib.Path, required=True, help="network to write: .onnx")
    given = parser.parse_args()
    torch.set_num_threads(given.threads)
    torch.manual_seed(given.seed)
    draw = torch.Generator().manual_seed(given.seed)
    data = np.load(given.pictures)
    colors, near = torch.from_numpy(data["color"]), torch.from_numpy(data["closeness"])
    held = dict(np.load(given.held_out)) if given.held_out else None
    network = DepthNetwork()
    print(f"{len(colors)} pictures, {sum(p.numel() for p in network.parameters())} weights", flush=True)
    network = network.to(memory_format=torch.channels_last)
    optimizer = torch.optim.AdamW(network.parameters(), lr=1e-3, weight_decay=1e-2)
    average = torch.optim.swa_utils.AveragedModel(network, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(0.998),
                                                  use_buffers=True)
    start, mean, step, done = time.time(), None, 0, 0.0
    while done < 1:
        done = max(step / given.steps, (time.time() - start) / (60 * given.minutes))
        rate = 2e-3 * min(1, (step + 1) / 100) * (0.5 + 0.5 * np.cos(np.pi * min(1, done))) + 1e-6
        for group in optimizer.param_groups:
            group["lr"] = rate
        chosen = torch.randint(len(colors), (given.batch,), generator=draw)
        size = SIZES[torch.randint(len(SIZES), (1,), generator=draw).item()]
        batch = augment(colors[chosen].permute(0, 3, 1, 2).float() / 255, near[chosen][:, None].float() / 255, size, draw)
        loss = loss_of(network(batch[0].contiguous(memory_format=torch.channels_last)), batch[1])
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        average.update_parameters(network)
        mean = loss.item() if mean is None else mean * 0.98 + loss.item() * 0.02
        step += 1
        if step % 100 == 0:
            print(f"step {step}, {time.time() - start:.0f} s: loss {mean:.4f}", flush=True)
        if held and step % 500 == 0:
            whole, visible = evaluate(average.module, held, 60)
            print(f"  held out: {whole.mean():.3f} of all pixels, {visible.mean():.3f} of visible ones", flush=True)
            export(average.module, given.out)
    if held:
        whole, visible = evaluate(average.module, held)
        print(f"held out, {len(whole)} pictures: {whole.mean():.3f} of all pixels, {visible.mean():.3f} of visible ones")
    export(average.module, given.out)


class Halved(nn.Module):
    """The network with weights of 16 bits, between inputs and outputs of 32."""

    def __init__(self, network):
        super().__init__()
        self.network = network.half()

    def forward(self, image):
        return self.network(image.half()).float()


def export(network, path):
    """Writes the network as ONNX: weights of 16 bits, batch normalisation folded into its convolutions."""
    halved = Halved(copy.deepcopy(network).to(memory_format=torch.contiguous_format)).eval()
    torch.onnx.export(halved, (torch.zeros(1, 3, 224, 384),), str(path), input_names=["image"], output_names=["closeness"],
                      dynamic_axes={"image": {2: "height", 3: "width"}, "closeness": {2: "height", 3: "width"}},
                      opset_version=17, dynamo=False)


if __name__ == "__main__":
    main()
