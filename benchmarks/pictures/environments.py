"""Draws each environment true beside perturbed, after the same actions from the same start.

    python environments.py OUT.png

Needs the package of client/python, Pillow and a built daemon; `make` beside this file has them. Agents
of data/agents choose the actions from what they observe in the true environment. The Humanoid, which
has no agent, gets zeros; Highway's car accelerates, until it has left the true road's three cars behind.
"""

import pathlib
import sys

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import b4mrl

AGENTS = pathlib.Path(__file__).resolve().parents[2] / "data" / "agents"
# Environment, perturbation, agent or constant action, seed, steps before the picture.
BODIES = [
    ("HalfCheetah", "gravity=2", "halfcheetah-expert.h5", 1, 48),
    ("Hopper", "leg=0.8", "hopper-expert.h5", 1, 72),
    ("Walker2d", "friction=0.3", "walker2d-expert.h5", 1, 60),
    ("Humanoid", "gravity=2", 17 * [0], 1, 32),
]
ROAD = ("Highway", "cars=15", [1, 0], 21, 11)
FRAME = (480, 360)  # pixels of a rendered body, of which the middle is shown
CUT = (90, 100, 390, 340)  # left, top, right, bottom
ROAD_FRAME = (1218, 150)
GAP = 6


def frames(client: b4mrl.Client, case: tuple, size: tuple[int, int]) -> list[Image.Image]:
    """The true environment and the perturbed one after the same actions."""
    name, perturbation, actor, seed, steps = case
    true, wrong = (
        client.make(name, simulator, render_mode="rgb_array", width=size[0], height=size[1])
        for simulator in (None, perturbation)
    )
    policy = b4mrl.load_agent(AGENTS / actor) if isinstance(actor, str) else lambda _: actor
    observation, _ = true.reset(seed=seed)
    wrong.reset(seed=seed)
    for _ in range(steps):
        action = np.asarray(policy(observation), dtype=np.float32)
        observation = true.step(action)[0]
        wrong.step(action)
    return [Image.fromarray(env.render()) for env in (true, wrong)]


def label(picture: Image.Image, text: str) -> Image.Image:
    draw = ImageDraw.Draw(picture)
    font = ImageFont.load_default(17)
    left, top, right, bottom = draw.textbbox((8, 6), text, font)
    draw.rectangle((left - 5, top - 5, right + 5, bottom + 5), fill="#202020")
    draw.text((8, 6), text, "white", font)
    return picture


def main() -> None:
    width, road_height = ROAD_FRAME
    body_height = CUT[3] - CUT[1]
    sheet = Image.new("RGBA", (width, 2 * (body_height + road_height + 2 * GAP) - GAP))
    with b4mrl.serve() as endpoint, b4mrl.connect(endpoint) as client:
        for column, case in enumerate(BODIES):
            for row, frame in enumerate(frames(client, case, FRAME)):
                text = f"{case[0]}, {case[1] if row else 'true'}"
                corner = (column * (CUT[2] - CUT[0] + GAP), row * (body_height + GAP))
                sheet.paste(label(frame.crop(CUT), text), corner)
        for row, frame in enumerate(frames(client, ROAD, ROAD_FRAME)):
            text = f"{ROAD[0]}, {ROAD[1] if row else 'true: 3 other cars'}"
            top = 2 * (body_height + GAP) + row * (road_height + GAP)
            sheet.paste(label(frame, text), (0, top))
    sheet.quantize(160).save(sys.argv[1], optimize=True)


if __name__ == "__main__":
    main()
