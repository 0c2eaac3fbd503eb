"""What plotly is told wherever it draws: no figure leaves this machine."""

from __future__ import annotations

from typing import Any


def private(*removed: str, **more: Any) -> dict[str, Any]:
    """Return plotly's configuration without the buttons that upload a figure, and without those that are named."""
    return {
        "displaylogo": False,
        "showSendToCloud": False,
        "showEditInChartStudio": False,
        "plotlyServerURL": "",
        "modeBarButtonsToRemove": ["sendChartToCloud", "sendDataToCloud", "editInChartStudio", *removed],
        **more,
    }
