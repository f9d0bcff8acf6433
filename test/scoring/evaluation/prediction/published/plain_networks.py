"""What CSP, STDAN and BAT are, written out for one sample at a time: every cell of the grid, every head, every point.

The networks of the library put samples together and leave empty cells out. Here is nothing of that, so that both have
to agree. Parameters are drawn, not trained, and drawn large: then every one of them is felt in the answer.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import elu, leaky_relu

from siren_ros.scoring.evaluation.prediction.published.networks import Bat, Csp, Stdan

torch.set_num_threads(1)  # the tests run next to each other

NETWORKS = {"csp": Csp, "stdan": Stdan, "bat": Bat}
POINTS, FUTURE, CELLS, ALONG = 16, 25, 39, 13
Around = Mapping[int, Tensor]
"""Neighbours of one sample by their cell: the features of their past, shape ``(16, F)``."""


def drawn(network: Any, seed: int = 7) -> Any:
    """The network with parameters from a generator of its own."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.copy_(torch.randn(parameter.shape, generator=generator) * 0.4)
    return network.eval()


def drawn_weights(model: str, folder: Path) -> dict[str, Path]:
    """By a model's name a file of weights that nobody trained: what does not depend on weights holds with them too."""
    path = folder / f"{model}.pt"
    torch.save(drawn(NETWORKS[model]()).state_dict(), path)
    return {model: path}


def recurrent(lstm: Any, sequence: Tensor) -> Tensor:
    """The hidden states of an LSTM over one sequence ``(T, F)``, gate by gate."""
    from_input, from_hidden, input_bias, hidden_bias = lstm.all_weights[0]
    hidden = cell = sequence.new_zeros(lstm.hidden_size)
    states = []
    for values in sequence:
        gates = from_input @ values + input_bias + from_hidden @ hidden + hidden_bias
        let_in, forget, new, let_out = gates.chunk(4)
        cell = torch.sigmoid(forget) * cell + torch.sigmoid(let_in) * torch.tanh(new)
        hidden = torch.sigmoid(let_out) * torch.tanh(cell)
        states.append(hidden)
    return torch.stack(states)


def gaussians(raw: Tensor) -> Tensor:
    """Means as they are, scales positive, correlation within ±1."""
    columns = [raw[:, 0], raw[:, 1], torch.exp(raw[:, 2]), torch.exp(raw[:, 3]), torch.tanh(raw[:, 4])]
    return torch.stack(columns, dim=1)


def chosen(mode: int, of: int) -> Tensor:
    """One of some manoeuvres."""
    return torch.tensor([1.0 if place == mode else 0.0 for place in range(of)])


def plain_csp(network: Any, past: Tensor, around: Around) -> tuple[Tensor, Tensor, Tensor]:
    """Modes ``(6, 25, 5)``, lateral and longitudinal probabilities of one sample with its past ``(16, 2)``."""

    def encoded(track: Tensor) -> Tensor:
        return recurrent(network.enc_lstm, leaky_relu(network.ip_emb(track), 0.1))[-1]

    grid = torch.zeros(64, ALONG, 3)
    for cell, track in around.items():
        column, along = divmod(cell, ALONG)
        grid[:, along, column] = encoded(track)
    weight, bias = network.soc_conv.weight, network.soc_conv.bias
    first = leaky_relu(torch.stack([(weight * grid[:, i : i + 3]).sum((1, 2, 3)) + bias for i in range(11)]), 0.1)
    weight, bias = network.conv_3x1.weight, network.conv_3x1.bias
    second = [(weight[..., 0] * first[i : i + 3].T).sum((1, 2)) + bias for i in range(9)]
    second = [leaky_relu(values, 0.1) for values in second]
    pooled = [second[0]] + [torch.maximum(second[i], second[i + 1]) for i in (1, 3, 5, 7)]
    context = torch.cat((torch.stack(pooled, dim=1).flatten(), leaky_relu(network.dyn_emb(encoded(past)), 0.1)))
    modes = []
    for mode in range(6):
        given = torch.cat((context, chosen(mode % 3, 3), chosen(mode // 3, 2)))
        modes.append(gaussians(network.op(recurrent(network.dec_lstm, given.repeat(FUTURE, 1)))))
    lateral, longitudinal = (torch.softmax(layer(context), 0) for layer in (network.op_lat, network.op_lon))
    return torch.stack(modes), lateral, longitudinal


def attended(query: Tensor, keys: Tensor, values: Tensor, scale: float) -> Tensor:
    """One query ``(D,)`` over K keys: the mean of the values, weighted by their likeness."""
    return torch.softmax(keys @ query / scale, dim=0) @ values


def four_heads(query: Tensor, keys: Tensor, values: Tensor) -> Tensor:
    """The same with the 192 numbers of each as four heads of 48."""
    heads = [slice(48 * head, 48 * head + 48) for head in range(4)]
    return torch.cat([attended(query[head], keys[:, head], values[:, head], 8.0) for head in heads])


def gated(layer: Any, values: Tensor) -> Tensor:
    """A linear layer, gated by a second one."""
    return layer.activation_layer(values) / (1.0 + torch.exp(-layer.gated_layer(values)))


def normalised(layer: Any, values: Tensor) -> Tensor:
    """Mean 0 and variance 1 over the last axis, then scaled and shifted."""
    centred = values - values.mean(dim=-1, keepdim=True)
    variance = (centred**2).mean(dim=-1, keepdim=True)
    return centred / torch.sqrt(variance + 1e-5) * layer.weight + layer.bias


def plain_generator(
    generator: Any, encoded: Tensor, mode: tuple[Tensor, Tensor] | None
) -> tuple[Tensor, Tensor, Tensor]:
    """Gaussians ``(25, 5)`` of a mode, and the probabilities of the manoeuvres; without a mode the likeliest is taken.

    A given mode chooses the mapping and is fed to the decoder; without one the decoder gets the probabilities.
    """
    state = elu(generator.mu_fc1(encoded[POINTS - 1]))
    state = elu(normalised(generator.normalize, generator.mu_fc(state)))
    lateral, longitudinal = (torch.softmax(layer(state), 0) for layer in (generator.op_lat, generator.op_lon))
    likeliest = chosen(int(lateral.argmax()), 3), chosen(int(longitudinal.argmax()), 3)
    across, along = mode or likeliest
    decoder, points = generator.Decoder, []
    for point in range(FUTURE):
        scores = torch.stack([generator.mapping[k, point] @ torch.cat((across, along)) for k in range(POINTS)])
        mapped = torch.softmax(scores, 0) @ encoded
        points.append(decoder.dec_linear(torch.cat((mapped, *(mode or (lateral, longitudinal))))))
    return gaussians(decoder.linear1(recurrent(decoder.lstm, torch.stack(points)))), lateral, longitudinal


def plain_stdan(network: Any, past: Tensor, around: Around) -> tuple[Tensor, Tensor, Tensor]:
    """Gaussians ``(25, 5)``, lateral and longitudinal probabilities of one sample with its past ``(16, 5)``."""
    gd = network.gd

    def encoded(track: Tensor) -> Tensor:
        return recurrent(gd.lstm, elu(gd.linear1(track)))

    target = encoded(past)
    cells = torch.zeros(CELLS, POINTS, 64)
    for cell, track in around.items():
        cells[cell] = encoded(track)
    social = []
    for point in range(POINTS):
        seen = cells[:, point]
        attention = four_heads(gd.qff(target[point]), gd.kff(seen), gd.vff(seen))
        social.append(normalised(gd.addAndNorm.normalize, target[point] + gated(gd.first_glu, attention)))
    over = torch.stack(social)
    keys, values = gd.kt(over), gd.vt(over)
    timed = torch.stack([gated(gd.second_glu, four_heads(gd.qt(point), keys, values)) for point in over])
    return plain_generator(network.g, normalised(gd.addAndNorm.normalize, target + timed), None)


def plain_bat_encoder(network: Any, scene: list[tuple[Tensor, Around, Tensor]]) -> list[Tensor]:
    """BAT's encoded past ``(16, 64)`` of each sample of a scene.

    Args:
        network: BAT.
        scene: Past ``(16, 8)``, neighbours and behaviour ``(16, 39, 6)`` of each sample.
    """
    gd = network.gd

    def encoded(track: Tensor) -> Tensor:
        return recurrent(gd.lstm, elu(gd.linear1(track)))

    everybody = [encoded(track) for _, around, _ in scene for _, track in sorted(around.items())]
    attention = gd.attention
    after = []
    for track in everybody:
        points = []
        for point in range(POINTS):
            there = torch.stack([other[point] for other in everybody])
            query = attention.linear_query(track[point])
            points.append(attended(query, attention.linear_key(there), attention.linear_value(there), math.sqrt(16)))
        after.append(torch.stack(points))
    behaviour = [
        recurrent(
            gd.lstm_behavior,
            torch.stack([leaky_relu(gd.linear_behavior(felt[point]), 0.1).flatten() for _, _, felt in scene]),
        )
        for point in range(POINTS)
    ]
    answers = []
    for number, (past, around, _) in enumerate(scene):
        own_neighbours = [after.pop(0) for _ in around]
        pooled = torch.stack(own_neighbours).mean(dim=0) if own_neighbours else torch.zeros(POINTS, 16)
        felt = torch.stack([behaviour[point][number] for point in range(POINTS)])
        all_of_it = torch.cat((encoded(past), pooled, felt), dim=1)
        answers.append(gated(gd.first_glu, gd.pre_glu_proj(all_of_it)))
    return answers
