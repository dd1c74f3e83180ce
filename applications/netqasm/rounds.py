"""NetQASM's request for a simulation, met by hosts: an application's programs, round by round.

Each host runs the programs of its own roles; others run theirs.
"""

from collections.abc import Callable, Mapping
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
    own = [
        program
        for program in app_instance.app.programs
        if placement.known(program.party) in placement.stacks
    ]

    def play(program: Program) -> Any:
        try:
            return begin(program)
        finally:
            ends[program.party].wait()

    def begin(program: Program) -> Any:
        inputs = dict(app_instance.program_inputs.get(program.party, {}))
        if use_app_config:
            host = placement.host(program.party)
            config = AppConfig(program.party, host, program.entry, log_cfg or LogConfig(), inputs)
            return program.entry(**inputs, app_config=config)
        return program.entry(**inputs)

    results = []
    with ThreadPoolExecutor(len(own)) as pool:
        for number in range(num_rounds):
            playing = {program.party: pool.submit(play, program) for program in own}
            results.append({party: each.result() for party, each in playing.items()})
            on_round(number)
    if post_function is not None:
        post_function(None)  # of a simulator there is nothing to hand over
    return results
