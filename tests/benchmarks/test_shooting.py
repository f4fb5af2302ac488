import casadi as ca
import numpy as np

from benchmarks.shooting import _added, _columns, _gaps_by, _hessian

P, COUNT, N, A = 3, 4, 7, 2
WAYS, SIZE = N + P + A, P + N * (COUNT + 1) + A * COUNT


def dense(expression: ca.MX) -> np.ndarray:
    return np.array(ca.DM(ca.evalf(expression)))


def test_slopes_and_second_derivatives_of_segments_go_where_their_unknowns_stand() -> None:
    """The sums that IPOPT gets, beside the same segment by segment on matrices that are mostly zero."""
    generator = np.random.default_rng(3)
    slopes, by = generator.normal(size=(WAYS, COUNT)), generator.normal(size=(COUNT, N, WAYS))
    bends = generator.normal(size=(COUNT, WAYS, WAYS))
    bends += bends.transpose(0, 2, 1)
    columns = _columns(P, COUNT)
    assert sorted({*columns.ravel().tolist()}) == [*range(P + N * COUNT), *range(P + N * (COUNT + 1), SIZE)]

    slope, gaps, hessian = np.zeros(SIZE), np.zeros((N * COUNT, SIZE)), np.zeros((SIZE, SIZE))
    for segment, own in enumerate(columns.T):
        rows = slice(N * segment, N * (segment + 1))
        slope[own] += slopes[:, segment]
        gaps[rows, own] -= by[segment]
        gaps[rows, P + N * (segment + 1) : P + N * (segment + 2)] += np.eye(N)
        hessian[np.ix_(own, own)] += bends[segment]
    np.testing.assert_allclose(dense(_added(ca.MX(ca.DM(slopes)), P)).ravel(), slope)
    side_by_side = ca.MX(ca.DM(np.concatenate(by, axis=1)))
    np.testing.assert_allclose(dense(_gaps_by(ca.vec(side_by_side), columns, SIZE, P)), gaps)
    square = ca.MX(ca.DM(np.stack([each.ravel(order="F") for each in bends], axis=1)))
    np.testing.assert_allclose(dense(_hessian(square, columns, SIZE, P)), np.triu(hessian))
