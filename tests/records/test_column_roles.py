"""What the names of columns say, in six languages, and what they do not say."""

import pytest

from wallid.records.column_detection import detect_columns
from wallid.records.column_roles import air_key, is_indoors, is_left, is_outdoors, is_right, stated_use
from wallid.records.file_format import FileFormat


@pytest.mark.parametrize(
    ("use", "names"),
    [
        ("irradiance", ("Globalstrahlung (W/m²)", "Sonnenstrahlung", "Irradiance", "solar radiation W/m2", "GHI")),
        ("irradiance", ("Rayonnement global", "ensoleillement", "Radiación solar", "Irraggiamento", "Zonnestraling")),
        ("flux", ("Wärmestrom [W/m²]", "Wärmeflussdichte", "heat flux", "q_int", "Flux thermique", "flujo de calor")),
        ("flux", ("Flusso termico", "Warmtestroom")),
        ("wind", ("Windgeschwindigkeit", "vitesse du vent", "viento", "wind (m/s)")),
        ("rain", ("Regen", "Niederschlag", "pluie", "lluvia", "pioggia", "neerslag")),
        ("heating", ("heating", "Heizleistung", "chauffage", "calefacción", "riscaldamento", "verwarming")),
        ("humidity", ("rel. Feuchte", "humidité", "umidità", "humedad", "luchtvochtigheid", "RH_1")),
        (None, ("T1", "ventilation", "M1 [°C]", "Tse", "dew point", "Temperatur")),
    ],
)
def test_uses(use, names):
    assert {name: stated_use(name) for name in names} == dict.fromkeys(names, use)


@pytest.mark.parametrize(
    ("key", "names"),
    [
        (
            "air_outdoor",
            ("Außenluft", "Aussenlufttemperatur", "T_ext", "air extérieur", "aire exterior", "Buitenlucht"),
        ),
        (
            "air_outdoor",
            ("Température extérieure", "aria esterna", "TairOut", "outdoor temperature", "weather station"),
        ),
        ("air_indoor", ("Raumluft", "Innentemperatur", "T_in", "air intérieur", "aria interna", "binnenlucht", "room")),
        (None, ("Wand außen", "Tse", "T_si", "T1", "T_left", "inner 3cm", "Temperatura interior pared", "T_air")),
    ],
)
def test_air(key, names):
    assert {name: air_key(name) for name in names} == dict.fromkeys(names, key)


def test_sides():
    for name in ("innen", "T_in", "intérieur", "interno", "binnen", "Tsi", "T_int"):
        assert is_indoors(name) and is_left(name) and not is_outdoors(name) and not is_right(name)
    for name in ("außen", "T_out", "extérieur", "esterno", "buiten", "Tse", "ext"):
        assert is_outdoors(name) and is_right(name) and not is_indoors(name) and not is_left(name)
    for left, right in (("links", "rechts"), ("gauche", "droite"), ("izquierda", "derecha"), ("sinistra", "destra")):
        assert is_left(left) and is_right(right)
    for name in ("house", "dew point", "T1", "phase"):
        assert not (is_left(name) or is_right(name))


def test_kinds_of_columns(tmp_path):
    """By their names, although the values could be temperatures; "hora" is the time."""
    path = tmp_path / "record.csv"
    rows = [f"{600 * k};{12 + k % 5};{20 + k % 3};{40 + k % 7};{k % 9};{5 + k % 2}" for k in range(40)]
    header = "hora (s);pared;Globalstrahlung;rel. Feuchte;Wind;Wärmestrom"
    path.write_text("\n".join([header, *rows]), encoding="utf-8")
    kinds = {column.name: column.kind for column in detect_columns(path, FileFormat()).columns}
    assert kinds == {
        "hora (s)": "time",
        "pared": "temperature",
        "Globalstrahlung": "irradiance",
        "rel. Feuchte": "number",
        "Wind": "number",
        "Wärmestrom": "flux",
    }
