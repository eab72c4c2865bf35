"""The emulated cell: devices that speak the real protocols, and the plant behind them."""
