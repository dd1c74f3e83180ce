"""A noise model of the user's own: the one of examples/, and bad ones."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import uvloop
from dispatcher_network import JumpingClock, block, configuration, running
from noise_cases import passage, within

from dispatcher.fiber import custom_noise
from dispatcher.layer.network import Network
from wire.config import BadConfig, QuantumSwitch

EXAMPLE = f"{Path(__file__).resolve().parents[3]}/examples/flicker.py:Flicker"
COUNT, BLOCKS = 10_000, 40


def test_the_example_flickers(tmp_path: Path) -> None:
    flip = 0.3
    config = configuration(tmp_path)
    fibers = [
        replace(fiber, noise=EXAMPLE, noise_parameters={"flip": flip})
        if fiber.a.port == "alice-q9"
        else fiber
        for fiber in config.fibers
    ]

    async def run() -> list[int]:
        async with running(replace(config, fibers=fibers), JumpingClock()) as bench:
            flipped = []
            for number in range(BLOCKS):
                await bench.alice.create(COUNT, number=number)
                halves = block(number, 0), block(number, 1)
                await bench.alice.send(*((half, "alice-q9") for half in halves[:1]))
                await bench.bob.receive(halves[0], "bob-q9")
                await bench.bob.send((halves[0], "bob-q9"))
                await bench.alice.receive(halves[0], "alice-q9")
                outcomes = (await bench.alice.bell_measure(*halves)).outcomes
                assert set(outcomes) <= {0, 2}
                flipped.append(outcomes.count(2))
            return flipped

    flipped = uvloop.run(run())
    # There and back: two lamps, each on half of the time.
    expected = {0: 0.0, 1: flip, 2: 2 * flip * (1 - flip)}
    lamps = [next(on for on, p in expected.items() if within(count, p, COUNT)) for count in flipped]
    assert set(lamps) == {0, 1, 2}
    assert abs(sum(lamps) - BLOCKS) < 5 * (BLOCKS / 2) ** 0.5


def test_a_model_of_the_user_s_own_is_named_when_it_cannot_be_made(tmp_path: Path) -> None:
    noise = EXAMPLE
    for reference, parameters, text in (
        (noise, {}, "flip"),
        (noise, {"flop": 1}, "flop"),
        (noise + "s", {"flip": 0.1}, "no class Flickers with a method effect"),
        (f"{tmp_path}/nowhere.py:Flicker", {}, "there is no file"),
        (EXAMPLE.replace("Flicker", "np"), {}, "no class np with a method effect"),
    ):
        with pytest.raises(BadConfig, match=text):
            custom_noise.load(reference, parameters)
    (tmp_path / "broken.py").write_text("def:")
    with pytest.raises(BadConfig, match="cannot be loaded"):
        custom_noise.load(f"{tmp_path}/broken.py:Flicker", {})


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        ("my_noise.py", r"file\.py:ClassName"),
        ("my_noise.py:", r"file\.py:ClassName"),
        (":Flicker", r"file\.py:ClassName"),
        (5, r"FILE\.py:CLASS"),
    ],
)
def test_a_reference_that_names_no_class_is_refused(
    tmp_path: Path, noise: object, words: str
) -> None:
    fiber = replace(configuration(tmp_path).fibers[0], noise=noise)  # type: ignore[arg-type]
    with pytest.raises(BadConfig, match=words):
        Network([fiber], [QuantumSwitch("q1")])


BAD_ANSWERS = {
    "None": "return an Effect",
    "Effect(lost=np.zeros(3, bool))": "lost is bool",
    "Effect(paulis=np.zeros(k))": "paulis is float64",
    "Effect(paulis=np.full(k, 4, np.uint8))": "Pauli 4 is not 0 to 3",
    "Effect(angles_rad=np.full(k, np.nan))": "angles_rad holds what is not a number",
    "Effect(delays_ps=0.5)": "delays_ps is 0.5",
    "Effect(transmission=1.5)": "transmission 1.5 is not 0 to 1",
    "Effect(exact=False)": "exact is False, and of what is named is",
    "Effect(exact=False, named='twirled')": "of what is named is 'twirled'; give named=approxim",
    "Effect(exact=False, named=Approximations({'twirled': None}))": "'twirled': None",
    "Effect(exact=False, named=Approximations({'twirled': 1.5}))": "'twirled': 1.5",
}


def test_a_model_that_raises_is_named_with_its_line_and_its_traceback_is_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "bad.py"
    file.write_text("class Bad:\n    def effect(self, passage):\n        raise KeyError('oh')\n")
    words = f"{file}:Bad: effect raised, at line 3: KeyError: 'oh'"
    with pytest.raises(BadConfig, match=f"^{words}; its traceback is in the log"):
        custom_noise.load(f"{file}:Bad", {}).effect(passage(10))
    assert words in caplog.text
    assert f'File "{file}", line 3, in effect' in caplog.text


@pytest.mark.parametrize("answer", BAD_ANSWERS)
def test_what_a_model_returns_is_checked(tmp_path: Path, answer: str) -> None:
    (tmp_path / "bad.py").write_text(
        "import numpy as np\n"
        "from dispatcher.approximations import Approximations\n"
        "from dispatcher.fiber.noise import Effect\n"
        "class Bad:\n"
        "    def effect(self, passage):\n"
        "        k = passage.photons\n"
        f"        return {answer}\n"
    )
    model = custom_noise.load(f"{tmp_path}/bad.py:Bad", {})
    with pytest.raises(BadConfig, match=BAD_ANSWERS[answer]):
        model.effect(passage(10))


def test_models_of_the_same_file_are_loaded_each_for_itself(tmp_path: Path) -> None:
    shutil.copy(EXAMPLE.partition(":")[0], tmp_path / "other.py")
    for reference in (EXAMPLE, f"{tmp_path}/other.py:Flicker"):
        model = custom_noise.load(reference, {"flip": 1.0, "switched": 0.0})
        paulis = model.effect(passage(10)).paulis
        assert paulis is not None
        assert np.array_equal(paulis, np.full(10, 2))
