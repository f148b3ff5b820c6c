"""How the table of trials looks: widths, order of columns, selection by rows."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableView

from rig.gui.habits import Habits
from rig.gui.trial_table import COLUMNS, TrialFilter

COLUMNS_LAYOUT = "trials.columns"

_WIDTHS = {"file": 180, "finger": 60, "depth mm": 88, "rep.": 52, "state": 96, "started": 140}
_OTHER_WIDTH = 92


def trial_view(shown: TrialFilter, habits: Habits) -> QTableView:
    """Return the view of the trials, its columns as they were left."""
    view = QTableView()
    view.setAccessibleName("trials")
    view.setModel(shown)
    view.setSortingEnabled(True)
    view.sortByColumn(0, Qt.SortOrder.AscendingOrder)
    view.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
    view.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
    view.setHorizontalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
    view.setAlternatingRowColors(True)
    view.setWordWrap(False)
    view.setTabKeyNavigation(False)
    view.verticalHeader().hide()
    view.verticalHeader().setDefaultSectionSize(view.fontMetrics().height() + 6)
    header = view.horizontalHeader()
    header.setSectionsMovable(True)
    header.setHighlightSections(False)
    header.setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
    for i, column in enumerate(COLUMNS):
        header.resizeSection(i, _WIDTHS.get(column.title, _OTHER_WIDTH))
    state = habits.layout(COLUMNS_LAYOUT)
    if state is not None:
        header.restoreState(state)
    return view
