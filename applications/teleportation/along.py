"""Photons that are made, and measured, along directions of their own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hosts.hardware import steps
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Outcomes, Symbols, symbols_of
from wire.dispatcher_pb2 import CreateRequest, Gate, MeasureRequest, Step


@dataclass(frozen=True)
class Directions:
    """Directions on the Bloch sphere, of k photons; both of shape (k,)."""

    theta_rad: NDArray[np.float64]  # from |0>
    phi_rad: NDArray[np.float64]  # about the Z axis, from |+>


async def prepare_along(qnic: Qnic, session: int, number: int, directions: Directions) -> BlockName:
    """Make a photon (half 0) in cos(theta/2) |0> + exp(i phi) sin(theta/2) |1> for each."""
    name = BlockName(session, number, 0)
    theta, phi = directions.theta_rad, directions.phi_rad
    zeros = CreateRequest(session=session, number=number, count=theta.size)
    zeros.state = CreateRequest.ZEROS
    about_y, about_z = Gate(name=Gate.RY, angles_rad=theta), Gate(name=Gate.RZ, angles_rad=phi)
    await qnic.perform(Step(create=zeros), steps.apply(name, None, about_y, about_z))
    return name


async def measure_along(
    qnic: Qnic, block: BlockName, directions: Directions, paulis: Symbols
) -> Outcomes:
    """Apply Paulis to photons at this host, and measure each along its direction.

    Return 0 for one found in its direction and 1 for the opposite, 255 where no detector
    clicked, and when; the photons are used up.
    """
    theta, phi = -directions.theta_rad, -directions.phi_rad
    about_z, about_y = Gate(name=Gate.RZ, angles_rad=phi), Gate(name=Gate.RY, angles_rad=theta)
    measure = MeasureRequest(block=steps.block_id(block), basis=MeasureRequest.Z)
    applied, measured = await qnic.perform(
        steps.apply(block, paulis, about_z, about_y), Step(measure=measure)
    )
    return Outcomes(symbols_of(measured), applied.time_ns)
