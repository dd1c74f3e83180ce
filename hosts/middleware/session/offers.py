"""Light that hosts offer: set-ups that ask for other light are refused."""

from dataclasses import replace

from hosts.middleware.session.errors import unsupported
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Service
from wire.optical import ANY_WAVELENGTH, frequency_mhz
from wire.services import memory_of


def check_light(setup: Setup) -> None:
    """Raise SessionError for light that no host here makes, takes or keeps."""
    offered = memory_of(Service(setup.service))
    if setup.memory not in offered:
        text = f"memory {setup.memory} for {Service(setup.service).name.lower()}: "
        text += f"choose {' or '.join(str(each.value) for each in offered)}"
        raise unsupported(text)
    settings = {
        "polarisation basis": setup.polarization,
        "phase": setup.phase_mrad,
    }
    offer_nothing_but_0(settings)
    check_wavelength(setup)


def offer_nothing_but_0(settings: dict[str, int]) -> None:
    for name, value in settings.items():
        if value:
            raise unsupported(f"{name} {value}: only 0 is offered yet")


def at_wavelength(setup: Setup, answer: Answer) -> Setup:
    """Return what was asked for with the wavelength that it was granted; SessionError for none."""
    if setup.wavelength_pm != ANY_WAVELENGTH:
        return setup
    granted = replace(setup, wavelength_pm=answer.wavelength_pm)
    check_wavelength(granted)
    return granted


def check_wavelength(setup: Setup) -> None:
    """Raise SessionError for a wavelength outside the optical range."""
    try:
        frequency_mhz(setup.wavelength_pm)
    except ValueError as error:
        raise unsupported(str(error)) from error
