"""The elements of a scene, as frozen data, and the registry of their kinds: a file and a line here each."""

from stickslip.model.elements.base import Element, Link, Named, Row
from stickslip.model.elements.block import AnyBlock, Block, Sampled, StateSpace
from stickslip.model.elements.body import Body
from stickslip.model.elements.book import GROUND, Book
from stickslip.model.elements.contact import Contact
from stickslip.model.elements.damper import Damper
from stickslip.model.elements.drive import Drive
from stickslip.model.elements.force import Force
from stickslip.model.elements.gap import Gap
from stickslip.model.elements.gear import Gear
from stickslip.model.elements.one_way import OneWay
from stickslip.model.elements.planetary import Planetary
from stickslip.model.elements.spring import Spring
from stickslip.model.elements.stop import Stop
from stickslip.model.elements.tie import Tie

__all__ = [
    "GROUND",
    "KINDS",
    "AnyBlock",
    "Block",
    "Body",
    "Book",
    "Contact",
    "Damper",
    "Drive",
    "Element",
    "Force",
    "Gap",
    "Gear",
    "Link",
    "Named",
    "OneWay",
    "Planetary",
    "Row",
    "Sampled",
    "Spring",
    "StateSpace",
    "Stop",
    "Tie",
]

# Every kind of element by the name of its table in a scene, in the order in which elements are entered: bodies and
# drives before the elements that join them, contacts before the other rows.
KINDS: dict[str, type[Element]] = {
    "bodies": Body,
    "drives": Drive,
    "contacts": Contact,
    "ties": Tie,
    "gears": Gear,
    "planetaries": Planetary,
    "one_ways": OneWay,
    "gaps": Gap,
    "stops": Stop,
    "springs": Spring,
    "dampers": Damper,
    "blocks": Block,
    "state_spaces": StateSpace,
    "sampled": Sampled,
    "forces": Force,
}
