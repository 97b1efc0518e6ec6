"""What agrees with the paper, what does not, what explains it, and how it was read."""

from collections.abc import Mapping, Sequence

from scenarios.paper.budget import Budget
from scenarios.paper.imitation.cells import activation_cells, depth_cells
from scenarios.paper.imitation.rows import MAE, mean_of
from scenarios.paper.numbers import TABLE_06_MM, TABLE_07_MM
from scenarios.paper.transfer.comparison import Contender
from scenarios.paper.words.transferred import epoch, others, plans
from scenarios.paper.work.cells import Cell, Result
from scenarios.reporting.page import Block, Heading, Paragraph

READINGS = (
    "Where the paper leaves a choice, this is what was read, and how the other reading "
    "is reached. Twelve inputs and yet sine and cosine: six angles go in as pairs, so "
    'eighteen numbers reach the network (Pretraining(encoding="plain_angles") gives '
    "twelve). Ta, Tb, Tc are torques about z, y, x, as KUKA's angles A, B, C are "
    "(table_5_plan(torque_order=(0, 1, 2)) gives x, y, z). The 80 % that establish the "
    "models are poses, not rows; of them a fifth chooses the epoch, which the paper's "
    "20 % did while it also judged. The first hidden layer is the weights that lead "
    "into it. DT-CNN's inputs are channels of a signal of length one, so kernels of "
    'one mix them all and pooling returns what it is given (Cnn("signal") makes them '
    "places, with which the order of inputs is lost). It is asked directly, as the "
    "text says (Alignment() and FineTuning() are the reference's ways). STDE is of "
    "signed errors in Tables 2 and 10, whose numbers allow no other, and of absolute "
    "ones elsewhere."
)


def report(
    budget: Budget, methods: Sequence[Contender], found: Mapping[Cell, Result]
) -> Sequence[Block]:
    """Return the section that weighs the results."""
    return [
        Heading("What agrees with the paper, what does not, and why"),
        Paragraph(_imitation(budget, found)),
        Paragraph(plans(methods)),
        Paragraph(epoch(budget, found)),
        Paragraph(others(budget, methods, found)),
        Paragraph(READINGS),
    ]


def _imitation(budget: Budget, found: Mapping[Cell, Result]) -> str:
    depth = {d: mean_of(c, found)[1, MAE] for d, c in depth_cells(budget).items()}
    sharp = {a: mean_of(c, found)[1, MAE] for a, c in activation_cells(budget).items()}
    best, theirs = (
        min(depth, key=lambda d: depth[d]),
        min(TABLE_06_MM, key=lambda d: TABLE_06_MM[d][1][0]),
    )
    order = sorted(sharp, key=lambda a: sharp[a])
    published = sorted(TABLE_07_MM, key=lambda a: TABLE_07_MM[a][1][0])
    same = "as in the paper" if order == published else "unlike the paper's"
    ours, paper = depth[4], TABLE_06_MM[4][1][0]
    explained = (
        ": the task is easier than its numbers suggest; what differs is the training "
        "(here Adam on mini-batches, a rate that rises and falls, inputs of size one)"
        if ours < paper
        else ": so few steps imitate worse"
    )
    return (
        f"Imitation. Four layers of 100 test at {ours:.3f} mm after "
        f"{budget.sweep.depth_steps} steps, the paper's at {paper:.3f} mm after "
        f"100,000{explained}. The best depth is {best} (paper: {theirs}); depths "
        "differ in how fast they learn as well as in how well, so this holds for these "
        "steps, and differences of less than the spread over seeds mean nothing. "
        f"Activations come in the order {', '.join(order)}, {same}."
    )
