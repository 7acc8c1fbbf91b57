"""What a command leaves behind: the names of its figures, and the format of `result.json`."""

DIAGNOSIS = {"missing.png", "residuals.png", "fit.png", "confusable.png", "windows.png", "periodogram.png"}
FIGURES = {"wall.png", "record.png", "design.png", "estimate.png", "reliability.png", "uncertainty.png", "loads.png"}
QUANTITY = {
    "type": ["object", "null"],
    "required": ["value", "std", "interval_95", "unit"],
    "properties": {
        "value": {"type": ["number", "null"]},
        "std": {"type": ["number", "null"]},
        "interval_95": {"type": "array", "minItems": 2, "maxItems": 2},
        "unit": {"const": "m2/s"},
    },
}
SCHEMA = {
    "type": "object",
    "required": [
        "schema", "case", "window", "diffusivity", "diffusivity_before", "verdict", "effects", "gap", "iterations",
        "seconds",
    ],
    "properties": {
        "schema": {"const": 1},
        "window": {"required": ["start", "end", "criterion"]},
        "diffusivity": QUANTITY,
        "diffusivity_before": QUANTITY,
        "verdict": {"enum": [None, "adequate", "named", "confusable", "unnamed", "uninformative"]},
        "effects": {
            "items": {
                "required": ["name", "target", "parameters", "alternatives", "expected_gain", "gain", "p_value"],
                "properties": {"alternatives": {"items": {"required": ["name", "target"]}}},
            },
        },
        "gap": {
            "type": ["object", "null"],
            "required": ["before_K", "after_K", "floor_K", "held_out_before_K", "held_out_after_K"],
        },
        "iterations": {"type": ["integer", "null"]},
    },
    # a command that does not look for effects names none
    "if": {"properties": {"verdict": {"enum": ["named", "confusable"]}}},
    "then": {"properties": {"effects": {"minItems": 1}}},
    "else": {"properties": {"effects": {"const": []}}},
}  # fmt: skip
