"""Stable-Baselines3 in the world of many: all robots share one policy, through SuperSuit.

python docs/examples/stable_baselines.py [STEPS [SCENARIO]]
"""

import sys

import gymnasium
import numpy as np
import supersuit
from stable_baselines3 import PPO
from stable_baselines3.common.utils import set_random_seed

import testbed

SENSES = 4  # tilt and the first two joints: what every robot here has


def as_box(observation, space, agent):
    """SuperSuit stacks and pads boxes only."""
    return np.concatenate([observation["tilt"], observation["joints"]])[:SENSES]


def shared_space(space, agent):
    return gymnasium.spaces.Box(-2 * np.pi, 2 * np.pi, (SENSES,), np.float32)


def make_envs(scenario, max_cycles=600):
    """Every robot of the world as one environment of a vector."""
    world = testbed.parallel_env(scenario, images=False, max_cycles=max_cycles)
    world = supersuit.observation_lambda_v0(world, as_box, shared_space)
    world = supersuit.pad_action_space_v0(world)  # the student also pans its rig
    world = supersuit.reward_lambda_v0(world, lambda metres: 100 * metres)
    vector = supersuit.pettingzoo_env_to_vec_env_v1(world)
    return supersuit.concat_vec_envs_v1(vector, 1, num_cpus=1, base_class="stable_baselines3")


def train(steps, scenario="whom_to_imitate", seed=0):
    envs = make_envs(scenario)
    set_random_seed(seed)  # SuperSuit's vectors cannot be given one
    model = PPO("MlpPolicy", envs, n_steps=64, batch_size=64, device="cpu")
    model.learn(steps)
    envs.close()
    return model


if __name__ == "__main__":
    model = train(*[int(a) for a in sys.argv[1:2]] or [20_000], *sys.argv[2:3])
    print(f"{model.num_timesteps} steps of all robots together")
