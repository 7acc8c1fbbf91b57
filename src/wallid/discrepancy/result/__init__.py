"""What a diagnosis found: its verdict, effects and wall properties, their summary and the entries of result.json."""
