"""Proximal policy optimisation in one file, after CleanRL: python docs/examples/ppo.py [DECISIONS [SEED]]."""

import sys
from pathlib import Path

import numpy as np
import torch
from gymnasium import wrappers
from torch.distributions import Normal
from torch.nn import Linear, Parameter, Sequential, Tanh

import testbed

CRAWLING = Path(__file__).with_name("crawling.yaml")
BATCH, EPOCHS, MINIBATCH, CLIP, GAMMA, LAMBDA = 1000, 10, 50, 0.2, 0.97, 0.95


def make_env(scenario):
    """The student alone acts, ten decisions a second, ten seconds an episode; rewards in centimetres."""
    env = testbed.focal_env(scenario, images=False, hold=6, max_cycles=600)
    env = wrappers.FlattenObservation(wrappers.RescaleAction(env, np.float32(-1), np.float32(1)))
    return wrappers.TransformReward(env, lambda metres: 100 * metres)


def network(inputs, outputs):
    return Sequential(Linear(inputs, 64), Tanh(), Linear(64, 64), Tanh(), Linear(64, outputs))


def train(decisions, seed=0, scenario=CRAWLING, batch=BATCH):
    """Returns of the episodes (cm), in the order in which they were lived."""
    torch.manual_seed(seed)
    env = make_env(scenario)
    inputs, outputs = env.observation_space.shape[0], env.action_space.shape[0]
    mean, value_of = network(inputs, outputs), network(inputs, 1)
    spread = Parameter(torch.full((outputs,), -0.5))
    weights = [*mean.parameters(), *value_of.parameters(), spread]
    optimiser = torch.optim.Adam(weights, lr=1e-3)

    def agent(seen):
        return Normal(mean(seen), spread.exp()), value_of(seen)[..., 0]

    (seen, _), returns, total = env.reset(seed=seed), [], 0.0
    for _ in range(decisions // batch):
        log = []
        for _ in range(batch):
            with torch.no_grad():
                policy, value = agent(torch.as_tensor(seen))
                action = policy.sample()
            following, reward, _, over, _ = env.step(action.clamp(-1, 1).numpy())
            log.append((torch.as_tensor(seen), action, policy.log_prob(action).sum(), value, reward, over))
            seen, total = following, total + reward
            if over:
                returns.append(total)
                seen, total = env.reset()[0], 0.0
        states, actions, before, values = (torch.stack([step[i] for step in log]) for i in range(4))
        advantages, ahead, next_value = torch.zeros(batch), 0.0, agent(torch.as_tensor(seen))[1].item()
        # Where time is up the world would go on: the last value stands for the rest.
        for t in reversed(range(batch)):
            value, reward, over = log[t][3].item(), *log[t][4:]
            surprise = reward + GAMMA * (value if over else next_value) - value
            advantages[t] = ahead = surprise + (0.0 if over else GAMMA * LAMBDA * ahead)
            next_value = value
        for pick in (pick for _ in range(EPOCHS) for pick in torch.randperm(batch).split(MINIBATCH)):
            policy, value = agent(states[pick])
            ratio = (policy.log_prob(actions[pick]).sum(-1) - before[pick]).exp()
            gain = (advantages[pick] - advantages.mean()) / (advantages.std() + 1e-8)
            surrogate = torch.min(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain).mean()
            loss = 0.5 * (value - (advantages + values)[pick]).square().mean() - surrogate
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(weights, 0.5)
            optimiser.step()
    env.close()
    return returns


if __name__ == "__main__":
    returns = train(*[int(a) for a in sys.argv[1:3]] or [20_000])
    print("centimetres in 10 s:", *np.round(returns, 1))
