"""LPIPS with random weights: the published layout of VGG-16 written out with torch modules is the reference."""

import numpy as np
import pytest
import torch
from torch import nn

from gsbridge.errors import InputError
from gsbridge.splats.lpips import Lpips


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(0)
    layers: list[nn.Module] = []
    channels = 3
    for width in (8, 8, "M", 8, 8, "M", 8, 8, 8, "M", 8, 8, 8, "M", 8, 8, 8):
        if width == "M":
            layers.append(nn.MaxPool2d(2, 2))
        else:
            layers += [nn.Conv2d(channels, width, 3, padding=1), nn.ReLU()]
            channels = width
    return nn.Sequential(*layers), [torch.rand(1, 8, 1, 1) for _ in range(5)]


def save(path, network, prefix="features."):
    features, linears = network
    content = {f"{prefix}{name}": value for name, value in features.state_dict().items()}
    content |= {f"lin{i}.model.1.weight": value for i, value in enumerate(linears)}
    torch.save(content, path)


def test_distance_follows_the_definition(tmp_path, network):
    save(tmp_path / "weights.pth", network)
    rng = np.random.default_rng(0)
    a, b = rng.random((2, 40, 33, 3), dtype=np.float32)
    features, linears = network
    shift, scale = torch.tensor([-0.030, -0.088, -0.188]), torch.tensor([0.458, 0.448, 0.450])
    taps = {3: 0, 8: 1, 15: 2, 22: 3, 29: 4}
    with torch.no_grad():
        x = ((torch.as_tensor(np.stack([a, b])) * 2 - 1 - shift) / scale).permute(0, 3, 1, 2)
        total = 0.0
        for number, layer in enumerate(features):
            x = layer(x)
            if number in taps:
                unit = x / (x.norm(dim=1, keepdim=True) + 1e-10)
                total += float(((unit[0] - unit[1]) ** 2 * linears[taps[number]][0]).sum(0).mean())
    distance = Lpips(tmp_path / "weights.pth")
    assert distance(a, b) == pytest.approx(total, rel=1e-4)
    assert distance(a, a) == 0


def test_unusable_weights_give_one_clear_line(tmp_path, network):
    with pytest.raises(InputError, match="do not exist"):
        Lpips(tmp_path / "none.pth")
    (tmp_path / "bad.pth").write_bytes(b"no weights")
    with pytest.raises(InputError, match="cannot be read"):
        Lpips(tmp_path / "bad.pth")
    save(tmp_path / "part.pth", (network[0][:10], network[1]))
    with pytest.raises(InputError, match="missing"):
        Lpips(tmp_path / "part.pth")
