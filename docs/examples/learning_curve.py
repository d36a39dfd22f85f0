"""Does PPO learn? Seeds against random actions: python docs/examples/learning_curve.py [--out FILE] [--seeds N]."""

from argparse import ArgumentParser
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import matplotlib
import numpy as np
import ppo
import torch
from matplotlib import pyplot
from scipy import stats

DECISIONS, WORKERS, LAST = 15_000, 2, 30
INK, GREY = "#1f5a99", "#777777"


def learnt(seed):
    torch.set_num_threads(1)
    return ppo.train(DECISIONS, seed)


def at_random(seed, episodes=LAST):
    """Returns of uniformly random actions."""
    env, rng, returns = ppo.make_env(ppo.CRAWLING), np.random.default_rng(seed), []
    for episode in range(episodes):
        env.reset(seed=1000 * seed + episode)
        over, total = False, 0.0
        while not over:
            _, reward, _, over, _ = env.step(rng.uniform(-1, 1, env.action_space.shape).astype(np.float32))
            total += reward
        returns.append(total)
    env.close()
    return returns


def mean_with_interval(each):
    """Mean over seeds and its 95% interval (BCa bootstrap over seeds)."""
    interval = stats.bootstrap((each,), np.mean, random_state=np.random.default_rng(0)).confidence_interval
    return np.mean(each), interval.low, interval.high


def main(out, seeds):
    with ProcessPoolExecutor(WORKERS, get_context("spawn")) as pool:
        curves, chance = (np.array(list(pool.map(f, range(seeds)))) for f in (learnt, at_random))
    last, blind = curves[:, -LAST:].mean(axis=1), chance.mean(axis=1)
    told = {"PPO, last": last, "random": blind, "difference": last - blind}
    for name, each in told.items():
        print("{}: {:.1f} cm in 10 s (95% interval {:.1f} to {:.1f})".format(name, *mean_with_interval(each)))

    window = np.ones(10) / 10
    smooth = np.array([np.convolve(curve, window, "valid") for curve in curves])
    decisions = (np.arange(smooth.shape[1]) + len(window)) * 100
    figure, axes = pyplot.subplots(figsize=(7, 3.6), layout="constrained")
    axes.plot(decisions, smooth.T, color=INK, alpha=0.25, linewidth=1)
    axes.plot(decisions, smooth.mean(axis=0), color=INK, linewidth=2)
    _, low, high = mean_with_interval(blind)
    axes.axhspan(low, high, color=GREY, alpha=0.4, linewidth=0)
    axes.annotate(f"PPO, mean of {seeds} seeds", (decisions[-1], smooth[:, -1].mean()), (-4, 8), color=INK,
                  textcoords="offset points", ha="right", va="bottom")  # fmt: skip
    axes.annotate("random actions", (decisions[-1], low), (-4, -4), color=GREY,
                  textcoords="offset points", ha="right", va="top")  # fmt: skip
    axes.set(xlabel="decisions", ylabel="centimetres in 10 s", xlim=(0, decisions[-1]))
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(out, dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    matplotlib.use("agg")
    parser = ArgumentParser()
    parser.add_argument("--out", type=Path, default=ppo.CRAWLING.parents[1] / "learning.png")
    parser.add_argument("--seeds", type=int, default=5)
    main(**vars(parser.parse_args()))
