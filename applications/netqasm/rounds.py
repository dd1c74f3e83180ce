"""NetQASM's request for a simulation, met by hosts: an application's programs, round by round.

Each host runs the programs of its own roles; others run theirs.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from netqasm.runtime.app_config import AppConfig
from netqasm.runtime.application import ApplicationInstance, Program
from netqasm.runtime.settings import Formalism
from netqasm.sdk.config import LogConfig

from applications.netqasm.placement import Placement
from applications.netqasm.round_end import RoundEnd


def simulate_application(
    placement: Placement,
    on_round: Callable[[int], None],
    ends: Mapping[str, RoundEnd],
    app_instance: ApplicationInstance,
    num_rounds: int = 1,
    network_cfg: Any = None,
    nv_cfg: Any = None,
    log_cfg: LogConfig | None = None,
    formalism: Formalism = Formalism.KET,
    use_app_config: bool = True,
    post_function: Callable[[Any], Any] | None = None,
    enable_logging: bool = True,
    hardware: str = "generic",
) -> list[dict[str, Any]]:
    """Run the programs of the roles that are here; return what they return, for each round.

    The words are SquidASM's. Formalism and hardware are those of the network that runs, and
    nothing is logged but by the programs. Raise ValueError where another network is asked for.
    """
    if network_cfg is not None or nv_cfg is not None:
        raise ValueError("network_cfg or nv_cfg: the network is the one that runs; leave them out")
    parts = app_instance.app.programs
    programs = [part for part in parts if placement.known(part.party) in placement.stacks]

    def play(program: Program) -> Any:
        inputs = dict(app_instance.program_inputs.get(program.party, {}))
        try:
            if use_app_config:
                return _with_config(program, inputs, placement, log_cfg or LogConfig())
            return program.entry(**inputs)
        finally:
            ends[program.party].wait()

    results = list(_rounds(play, programs, num_rounds, on_round))
    if post_function is not None:
        post_function(None)  # of a simulator there is nothing to hand over
    return results


def _rounds(
    play: Callable[[Program], Any],
    programs: Sequence[Program],
    num_rounds: int,
    on_round: Callable[[int], None],
) -> Iterator[dict[str, Any]]:
    with ThreadPoolExecutor(len(programs)) as pool:
        for number in range(num_rounds):
            playing = {program.party: pool.submit(play, program) for program in programs}
            yield {party: future.result() for party, future in playing.items()}
            on_round(number)


def _with_config(
    program: Program, inputs: dict[str, Any], placement: Placement, log_cfg: LogConfig
) -> Any:
    host = placement.host(program.party)
    config = AppConfig(program.party, host, program.entry, log_cfg, inputs)
    return program.entry(**inputs, app_config=config)
