"""The USB adapters that lidars are sold with; the families share them."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Adapter:
    """A kind of USB adapter."""

    vendor: int  # USB vendor number
    product: int  # USB product number
    fastest: int  # highest speed in its data sheet, bits a second; 0 if the speed means nothing to it


ADAPTERS: Final = {
    "CP2102": Adapter(0x10C4, 0xEA60, 1_000_000),
    "CH340": Adapter(0x1A86, 0x7523, 2_000_000),
    "CH9102": Adapter(0x1A86, 0x55D4, 4_000_000),
    "STM32 virtual port": Adapter(0x0483, 0x5740, 0),
    "PL2303": Adapter(0x067B, 0x2303, 6_000_000),
    "FT232": Adapter(0x0403, 0x6001, 3_000_000),
    "FT231X": Adapter(0x0403, 0x6015, 3_000_000),
}
"""The adapters by the names that `lidario.PortInfo.adapter` uses. Speeds are from the makers' data sheets."""
