"""A tamper seal: entangled photons watch a fibre (Williams, Britt and Humble 2016).

    opener                                 source                           acceptor
      | <--- half 0 ------------------------ | --- half 1, which is watched ---> |
      | measures in Z or X by chance                  measures in Z or X by chance
      | Values(OVER) ----------------------------------------------------------> |
      | <----------------------------------------- Values(BASES), then OUTCOMES  |
      | where bases are equal: do the outcomes, too?  -> SequentialTest

An intruder who measures halves on the way and sends them on cannot know the bases that will be
chosen, and breaks the correlation in the other one: visibility V = 1 - 2 error sinks from 1 to 1 -
f/2. An opener that is the source keeps half 0; then only the way between the two is watched. It
ends between two blocks when the controller says that a session wants its light. Where no light
comes the session ends with an error: a fibre that is cut is not a seal. protocol.py decides; here
it is carried out.
"""

from applications.sealing.protocol import SealOptions, Watch, answer
from hosts.middleware.session.ends import AcceptorEnd, OpenerEnd, ServiceKind, Watched
from hosts.middleware.session.errors import SessionError
from wire.metadata.vocabulary import Reason, Service


async def watch(end: OpenerEnd, options: SealOptions) -> None:
    seen = Watch(end.side, options, lambda: end.wanted_back)
    ended = Reason.PROTOCOL
    try:
        await end.perform(seen.run())
        ended = Reason.BUSY if seen.preempted else Reason.OK
    except SessionError as error:
        ended = error.reason
        raise
    finally:
        end.watched = Watched(seen.compared, seen.errors, seen.whole, seen.alarm, ended)
    end.summary = seen.summary()


async def accept(end: AcceptorEnd) -> None:
    await end.perform(answer(end.side))


KIND = ServiceKind(Service["SEAL"], SealOptions, watch, accept)
