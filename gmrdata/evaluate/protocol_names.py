"""Names of the protocols, for those who don't need what is behind them."""

from typing import Literal

ProtocolName = Literal["gmr", "wham", "tram", "gvhmr", "slahmr", "emdb"]
