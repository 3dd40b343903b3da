"""Names of the reporting that other packages use, by the module that defines them."""

from .figures.plan import (
    DEFAULT_WIDTH as DEFAULT_WIDTH,
    NAMED_WIDTHS as NAMED_WIDTHS,
    write_simulation_figures as write_simulation_figures,
)
from .figures.process import (
    FigureProcess as FigureProcess,
    write_figures_of_file as write_figures_of_file,
)
from .figures.sizing import (
    map_figure as map_figure,
    payload_curves_figure as payload_curves_figure,
    prediction_figure as prediction_figure,
    map_speeds as map_speeds,
    write_sizing_figures as write_sizing_figures,
)
from .figures.style import (
    COLOURS as COLOURS,
    FIFTH_COLOUR as FIFTH_COLOUR,
    LIMIT_STYLE as LIMIT_STYLE,
    FONT_SIZE as FONT_SIZE,
    finish_axes as finish_axes,
    draw_legend as draw_legend,
    draw_legend_above as draw_legend_above,
    new_figure as new_figure,
    save_figure as save_figure,
    save_figures as save_figures,
    shade_phases as shade_phases,
    draw_zero_lines as draw_zero_lines,
)
from .figures.workspace import (
    axes_figure as axes_figure,
    design_region_figure as design_region_figure,
    tool_directions as tool_directions,
    publish_figures as publish_figures,
    reachable_set_figure as reachable_set_figure,
    workspace_figures as workspace_figures,
)
from .html.compare import comparison_data as comparison_data, write_comparison as write_comparison
from .html.outcome import write_outcome as write_outcome
from .html.page import PAGE_MARK as PAGE_MARK
from .html.page import render_page as render_page
from .html.report import report_page as report_page, write_report as write_report
from .html.scene import link_sides as link_sides, mechanism_scene as mechanism_scene
from .html.simulation import write_simulation_page as write_simulation_page
from .text import (
    Table as Table,
    VERDICT_LABELS as VERDICT_LABELS,
    answer_lines as answer_lines,
    explanation_lines as explanation_lines,
    limit_cells as limit_cells,
    limits_table as limits_table,
    proof_table as proof_table,
    selection_lines as selection_lines,
    simulation_tables as simulation_tables,
    sizing_lines as sizing_lines,
    sizing_verdict_lines as sizing_verdict_lines,
    summary_lines as summary_lines,
    unit_of_limit as unit_of_limit,
    what_if_lines as what_if_lines,
)
