"""Coins, as every process knows them."""

from qmn.services import (
    ABSORB,
    ACCEPTOR,
    EMIT,
    MEASURE,
    OPENER,
    PAIRS,
    SOURCE,
    STORE,
    Figures,
    RegisteredService,
)


class CoinFigures(Figures):
    """Results of either end's application, which `result.json` keeps."""

    coins: int
    agreed: int


COIN = RegisteredService(
    name="coin",
    number=100,
    title="Common coins",
    light=PAIRS,
    needs={
        SOURCE: EMIT,
        OPENER: ABSORB | STORE | MEASURE,
        ACCEPTOR: ABSORB | STORE | MEASURE,
    },
    ends="coin.ends:KIND",
    figures=(CoinFigures,),
)
