from bench.reporting.cluster_view import draw_cluster
from tests.reporting.factories import cluster_view


def test_both_views_with_the_enlarged_object():
    figure = draw_cluster(cluster_view())
    plan, picture = figure.axes
    assert plan.get_xlabel() == "y (m), left of the host"
    assert plan.get_xlim()[0] > plan.get_xlim()[1]  # y grows to the left
    assert plan.get_ylim()[0] < plan.get_ylim()[1]  # x grows upwards
    assert len(picture.child_axes) == 1


def test_a_cluster_of_named_points_has_no_outline():
    with_outline, without = (draw_cluster(cluster_view(outline=o)).axes[0].patches for o in (True, False))
    assert len(without) == len(with_outline) - 1
