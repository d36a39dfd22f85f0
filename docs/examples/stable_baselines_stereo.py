"""Stable-Baselines3 on stereo images: the student alone learns, its teachers crawl by their scripts.

python docs/examples/stable_baselines_stereo.py [STEPS]
"""

import sys

import gymnasium
import numpy as np
from stable_baselines3 import SAC

import testbed
from testbed.scenario import as_scenario


def make_env(scenario="whom_to_imitate"):
    """Both images as the two channels of one, which Stable-Baselines3 gives to a convolutional network."""
    scenario = as_scenario(scenario)
    rig = scenario.rig.model_copy(update={"renderer": "analytic"})
    env = testbed.focal_env(scenario.model_copy(update={"rig": rig}), hold=6, max_cycles=600)
    spaces = dict(env.observation_space.spaces)
    spaces["stereo"] = gymnasium.spaces.Box(0, 255, (2, *spaces.pop("left").shape), np.uint8)
    del spaces["right"]

    def stacked(observation):
        images = np.stack([observation["left"], observation["right"]])
        return {"tilt": observation["tilt"], "joints": observation["joints"], "stereo": images}

    return gymnasium.wrappers.TransformObservation(env, stacked, gymnasium.spaces.Dict(spaces))


def train(steps, seed=0):
    env = make_env()
    model = SAC("MultiInputPolicy", env, buffer_size=2_000, learning_starts=50, batch_size=32, seed=seed)
    model.learn(steps)
    env.close()
    return model


if __name__ == "__main__":
    print(f"{train(int((sys.argv[1:] or [2000])[0])).num_timesteps} decisions")
