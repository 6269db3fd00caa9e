"""Physically based training data for single-image reflection removal, rendered while you train.

Two photographs with depth become surfaces, with a pane of glass and a camera between them. A *tuple* has four linear
pictures of such a scene: `input` (I, what the camera sees), `transmission` (T, the scene behind the glass),
`glass_reflection` (R~, what the glass adds) and `clean_reflection` (R, the reflected scene itself).

- `render` renders one scene; `read` reads what the command `glasshouse` rendered; `plan` turns a recipe into scenes.
- `Tuples` is a data set that renders its scenes when they are asked for.
- `Mixtures` is a data set of training examples, composed of a run's tuples in linear light and behind a camera.
- `glasshouse.torch.Stream` reads either without end, on several ranks and workers, and resumes.
- `glasshouse.adapters` turns examples into the dictionaries of XReflection, ERRNet, DSRNet and RDNet.
- `python -m glasshouse.train` trains the networks of `glasshouse train` in PyTorch.
"""

from . import adapters
from ._native import TRACER_VERSION, GlasshouseError, SceneError, __version__, blake3
from .examples import Examples, Mixtures, initial_weights, train_settings
from .planning import plan
from .rendering import Rendered, Run, read, render
from .tuples import Tuples

__all__ = [
    "TRACER_VERSION",
    "Examples",
    "GlasshouseError",
    "Mixtures",
    "Rendered",
    "Run",
    "SceneError",
    "Tuples",
    "__version__",
    "adapters",
    "blake3",
    "initial_weights",
    "plan",
    "read",
    "render",
    "train_settings",
]
