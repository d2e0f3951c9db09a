#!/usr/bin/env python3
"""Trains the prior of packed infobytes (SPEC 5.9) on mapped models and writes its 4136 weights as lines of hex.

Inputs and sums are those of src/format/SPEC.md, 5.9. At most NODES nodes of each model are drawn; cells and nodes
outside a node's cube are absent. The same models and the same numpy give the same weights.
Needs numpy. usage: train_prior.py OUT.hex MODEL.oct...
"""
import struct
import sys

import numpy as np

NODES, EPOCHS, BATCH, RATE, HIDDEN, CUBE = 100_000, 12, 1024, 4e-3, 32, 7


def row(y, z, xs):
    return [(x, y, z) for x in xs]


SIX, FOUR, FIVE, THREE = range(-2, 4), range(-1, 3), range(-2, 3), range(-1, 2)
CELLS = ([at for y in SIX for at in row(y, -1, SIX)] + [at for y in FOUR for at in row(y, -2, FOUR)]
         + row(-1, 0, SIX) + row(-1, 1, SIX) + row(-2, 0, FOUR) + row(-2, 1, FOUR)
         + [at for z in (0, 1) for y in (0, 1) for at in row(y, z, (-2, -1))])
BOXES = ([(1, 0, 0), (2, 0, 0)] + row(1, 0, FIVE) + row(2, 0, THREE) + row(-1, 1, FIVE) + row(0, 1, FIVE)
         + row(1, 1, FIVE) + [(0, -1, 2)] + row(0, 2, THREE) + [(0, 1, 2)])


def present(grid, at, step, side):
    """Whether there are boxes a step away, in the same cube, whose side this is."""
    there = at + step
    inside = np.all(there // side == at // side, axis=1)
    there = np.where(inside[:, None], there, 0)
    return inside & grid[there[:, 2], there[:, 1], there[:, 0]]


def samples(path, random):
    """Inputs and infobytes of some nodes."""
    data = open(path, "rb").read()
    depth, sections = data[13], {}
    for at in range(64, 64 + 48 * struct.unpack_from("<H", data, 14)[0], 48):
        offset, size = struct.unpack_from("<QQ", data, at + 8)
        sections[data[at:at + 4]] = data[offset:offset + size]
    levels = np.frombuffer(sections[b"LEVL"], "<u8").astype(int)
    infobytes = np.frombuffer(sections[b"NODE"], np.uint8)
    nodes, grid = np.zeros((1, 3), int), np.ones((1, 1, 1), bool)
    inputs, masks = [], []
    for level in range(depth):
        mask = infobytes[levels[level]:levels[level + 1]]
        bits = (mask[:, None] >> np.arange(8) & 1).astype(bool)
        octants = np.array([[o & 1, o >> 1 & 1, o >> 2] for o in range(8)])
        children = (2 * nodes[:, None] + octants)[bits]
        below = np.zeros((2 << level,) * 3, bool)
        below[children[:, 2], children[:, 1], children[:, 0]] = True
        drawn = np.flatnonzero(random.random(len(mask)) < NODES / len(infobytes))
        first, side = nodes[drawn], 1 << max(level - max(depth - CUBE, 0), 0)
        columns = []
        for x, y, z in CELLS:
            # A cell's cube is that of its node; its first cell stands for the node.
            there = 2 * first + (x, y, z)
            inside = np.all(there // (2 * side) == first // side, axis=1)
            there = np.where(inside[:, None], there, 0)
            columns.append(inside & below[there[:, 2], there[:, 1], there[:, 0]])
        columns += [present(grid, first, step, side) for step in BOXES]
        columns += [np.full(len(drawn), level + 1 == depth), np.full(len(drawn), level + 2 == depth)]
        inputs.append(np.stack(columns, 1))
        masks.append(mask[drawn])
        nodes, grid = children, below
    return np.concatenate(inputs), np.concatenate(masks)


def train(inputs, masks, random):
    """First layer, rows of own bits, biases, second layer, its biases."""
    def normal(*shape, by):
        return (random.standard_normal(shape) * by).astype(np.float32)

    weights = [normal(112, HIDDEN, by=.15), normal(8, HIDDEN, by=.15), np.zeros(HIDDEN, np.float32),
               normal(8, HIDDEN, by=.2), np.zeros(8, np.float32)]
    first, second = [[np.zeros_like(w) for w in weights] for _ in range(2)]
    count, steps = len(masks), 0
    total = EPOCHS * (count // BATCH)
    for epoch in range(EPOCHS):
        order, cost = random.permutation(count), 0.
        for at in range(0, count - BATCH + 1, BATCH):
            drawn = order[at:at + BATCH]
            x = inputs[drawn].astype(np.float32)
            bits = (masks[drawn][:, None] >> np.arange(8) & 1).astype(np.float32)
            one, own, low, two, bias = weights
            before = np.cumsum(bits[:, :, None] * own, 1)
            sums = (x @ one + low)[:, None, :] + np.concatenate([np.zeros_like(before[:, :1]), before[:, :7]], 1)
            active = np.maximum(sums, 0)
            logit = np.einsum("boh,oh->bo", active, two) + bias
            wrong = 1 / (1 + np.exp(-logit)) - bits
            # The last bit is implied if the others are 0.
            wrong[:, 7] *= bits[:, :7].any(1)
            cost += -np.log2(np.maximum(1 - np.abs(wrong), 1e-9)).sum()
            wrong /= BATCH
            back = wrong[:, :, None] * two * (sums > 0)
            later = np.cumsum(back[:, ::-1], 1)[:, ::-1]
            whole = later[:, 0]
            after = np.concatenate([later[:, 1:], np.zeros_like(later[:, :1])], 1)
            slopes = [x.T @ whole, np.einsum("bo,boh->oh", bits, after), whole.sum(0),
                      np.einsum("bo,boh->oh", wrong, active), wrong.sum(0)]
            steps += 1
            rate = RATE * (1 - steps / (total + 1))
            for w, s, a, b in zip(weights, slopes, first, second):
                a += .1 * (s - a)
                b += .001 * (s * s - b)
                w -= rate * (a / (1 - .9 ** steps)) / (np.sqrt(b / (1 - .999 ** steps)) + 1e-8)
                np.clip(w, -7.9, 7.9, out=w)
        print(f"{epoch}: {cost / (count // BATCH * BATCH):.4f} bits a node", file=sys.stderr)
    return weights


def main():
    random = np.random.Generator(np.random.PCG64(24))
    parts = [samples(path, random) for path in sys.argv[2:]]
    weights = train(np.concatenate([p for p, _ in parts]), np.concatenate([m for _, m in parts]), random)
    whole = [np.clip(np.rint(w * 16), -127, 127).astype(np.int8) for w in weights]
    # No hidden sum of 16 bits, in 1/256, may overflow.
    most = 16 * sum(np.maximum(side * np.concatenate([whole[0], whole[1], whole[2][None]]).astype(int), 0).sum(0).max()
                    for side in (1,)), 16 * np.maximum(-np.concatenate(whole[:3], axis=None).reshape(-1, HIDDEN).astype(int), 0).sum(0).max()
    if max(most) > 32767:
        sys.exit(f"hidden sums reach {max(most)}: too large")
    text = b"".join(w.tobytes() for w in whole).hex()
    with open(sys.argv[1], "w") as out:
        out.writelines(text[at:at + 94] + "\n" for at in range(0, len(text), 94))


if __name__ == "__main__":
    main()
