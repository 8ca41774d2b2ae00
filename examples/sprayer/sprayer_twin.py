"""The simulated twin of `sprayer_functions`: the same functions, with no board behind them."""

__all__ = ["temperature"]


def temperature() -> float:
    return 45.0
