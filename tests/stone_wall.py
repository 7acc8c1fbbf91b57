"""A section of five stones in mortar, 0.3 m x 0.24 m, that several tests share, and its case file."""

from collections.abc import Iterable

from wallid.case.section import Region

LENGTH, HEIGHT = 0.3, 0.24  # m
REGIONS = (
    Region("mortar", (0.0, 0.3), (0.0, 0.24)),
    Region("stone", (0.0, 0.11), (0.0, 0.1)),
    Region("stone", (0.15, 0.3), (0.0, 0.1)),
    Region("stone", (0.0, 0.18), (0.14, 0.24)),
    Region("stone", (0.22, 0.3), (0.14, 0.24)),
)


def case_text(
    materials: dict[str, tuple[float, float]],
    sensors: Iterable[tuple[str, float, float | None]],
    noise_std: float,
    record: Iterable[str] = (),
    choices: Iterable[str] = (),
) -> str:
    """A case.toml of the wall with the record in record.csv, columns `time`, `left`, `right` and the sensors'.

    Args:
        materials: conductivity and heat capacity by name.
        sensors: name, position and height; None for a height that is not known.
        noise_std: of the sensors, K.
        record, choices: further lines of these tables.
    """
    lines = ["[wall]", f"length = {LENGTH}", "[record]", 'file = "record.csv"', 'time = "time"', 'left = "left"']
    lines += ['right = "right"', *record, "[choices]", 'model = "lom"', *choices, "[section]", f"height = {HEIGHT}"]
    for name, (k, c) in materials.items():
        lines += ["[[section.material]]", f'name = "{name}"', f"conductivity = {k}", f"heat_capacity = {c}"]
    for one in REGIONS:
        lines += ["[[section.region]]", f'material = "{one.material}"', f"x = {list(one.x)}", f"y = {list(one.y)}"]
    for name, position, height in sensors:
        lines += ["[[sensor]]", f'name = "{name}"', f"position = {position}", f"noise_std = {noise_std}"]
        lines += [] if height is None else [f"height = {height}"]
    return "\n".join(lines)
