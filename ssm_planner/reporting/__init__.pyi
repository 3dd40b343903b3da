"""Names of the reporting that other packages use, by the module that defines them."""

from .figures.plan import (
    WIDE as WIDE,
    WIDTHS as WIDTHS,
    write_simulation_figures as write_simulation_figures,
)
from .figures.process import (
    FigureProcess as FigureProcess,
    write_figures_of_file as write_figures_of_file,
)
from .figures.sizing import (
    map_figure as map_figure,
    payload_curves as payload_curves,
    prediction_figure as prediction_figure,
    speeds_of_map as speeds_of_map,
    write_sizing_figures as write_sizing_figures,
)
from .figures.style import (
    COLOURS as COLOURS,
    FIFTH as FIFTH,
    LIMIT as LIMIT,
    SIZE as SIZE,
    finish as finish,
    legend as legend,
    legend_above as legend_above,
    new_figure as new_figure,
    save_figure as save_figure,
    save_figures as save_figures,
    shade_phases as shade_phases,
    zero_lines as zero_lines,
)
from .figures.workspace import (
    axes_figure as axes_figure,
    design_region_figure as design_region_figure,
    pointings as pointings,
    publish_figures as publish_figures,
    reachable_set_figure as reachable_set_figure,
    workspace_figures as workspace_figures,
)
from .html.compare import comparison_data as comparison_data, write_comparison as write_comparison
from .html.outcome import write_outcome as write_outcome
from .html.page import render as render
from .html.report import report_page as report_page, write_report as write_report
from .html.scene import link_sides as link_sides, mechanism_scene as mechanism_scene
from .html.simulation import write_simulation_page as write_simulation_page
from .text import (
    Table as Table,
    VERDICT_LABELS as VERDICT_LABELS,
    answers as answers,
    explanation as explanation,
    limit_cells as limit_cells,
    limits_table as limits_table,
    proof_table as proof_table,
    selection_lines as selection_lines,
    simulation_tables as simulation_tables,
    sizing_lines as sizing_lines,
    sizing_verdict as sizing_verdict,
    summary_lines as summary_lines,
    unit_of_limit as unit_of_limit,
    what_if_lines as what_if_lines,
)
