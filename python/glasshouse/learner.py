"""The learner of a stage: its networks, losses and optimisers, which are those of `glasshouse train`."""

import json
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from glasshouse import networks
from glasshouse.networks import FEATURE_DIVISORS, mean_of_processes, process_count

Settings = dict[str, Any]
Tensors = dict[str, Tensor]

# Values of the settings with a choice, and all other settings; those of the last line concern the examples alone.
CHOICES: dict[str, tuple[Any, ...]] = {
    "features": ("none", "random", "file"),
    "feature_style": ("torch", "caffe"),
    "network": ("generator", "unet"),
    "start": ("identity", "random", "residual"),
    "optimizer": ("adam", "adamw"),
    "schedule": ("constant", "cosine", "step"),
    "real_share": (0,),
}
OTHERS = (
    "seed vgg_divisor width discriminator_width bound learning_rate betas weight_decay warmup_steps schedule_steps"
    " decay_steps decay_factor clip_norm ema pixel_weight gradient_weight feature_weight adversarial_weight"
    " discriminator_every a_priori discriminator_learning_rate"
    " batch crop_px flip scenes examples composition pixels follow"
).split()


class TrainError(Exception):
    """A failed training."""

    def __init__(self, text: str, exit_code: int = 1) -> None:
        """Takes a message and the exit code, which is that of `glasshouse train`."""
        super().__init__(text)
        self.exit_code = exit_code


def checked(settings: Mapping[str, Any]) -> Settings:
    """Returns a copy of the settings; raises TrainError if one is missing, unknown or not supported."""
    for name in [*CHOICES, *OTHERS]:
        if name not in settings:
            raise TrainError(f"the setting {name} is missing: resume once with `glasshouse train`, which adds it", 2)
    for name, value in settings.items():
        if name not in CHOICES and name not in OTHERS and name != "sensor":
            raise TrainError(f"the setting {name} is unknown to this version of the PyTorch trainer", 2)
        if value not in CHOICES.get(name, (value,)):
            expected = " or ".join(json.dumps(choice) for choice in CHOICES[name])
            raise TrainError(f"the setting {name} is {json.dumps(value)}, but the PyTorch trainer needs {expected}", 2)
    if settings["network"] == "unet" and (settings["a_priori"] or settings["start"] != "residual"):
        raise TrainError('the setting network is "unet", which needs a_priori = false and start = "residual"', 2)
    return dict(settings)


def rate(settings: Settings, step: int, name: str = "learning_rate") -> float:
    """Returns the learning rate of a step, counted from 1; `name` is the setting of its largest value."""
    if name == "discriminator_learning_rate" and settings[name] == 0:
        name = "learning_rate"
    course = 1.0
    if settings["schedule"] == "cosine":
        course = 0.5 * (1 + math.cos(math.pi * min(1.0, step / max(1, settings["schedule_steps"]))))
    elif settings["schedule"] == "step":
        course = float(settings["decay_factor"] ** sum(past < step for past in settings["decay_steps"]))
    warmth = min(1.0, step / settings["warmup_steps"]) if settings["warmup_steps"] else 1.0
    return float(settings[name]) * warmth * course


class Losses(NamedTuple):
    """The loss of a step, its weighted terms, and the discriminator's loss if it learned."""

    total: float
    terms: dict[str, float]
    discriminator: float | None


class Learner:
    """The networks of a stage, their optimisers and the running means of their weights.

    `steps` and `judge_steps` count the steps of the generators' and of the discriminator's optimiser.
    """

    def __init__(
        self,
        settings: Settings,
        stage: str,
        vgg: Mapping[str, Tensor] | None,
        device: torch.device,
        precision: str = "f32",
    ) -> None:
        """Creates networks of zeros; `vgg` has the weights of VGG-19 if the settings use features.

        Raises TrainError if a weight of VGG-19 is missing or if the stage has no such network.
        """
        self.settings, self.stage, self.device, self.precision = settings, stage, device, precision
        if settings["network"] == "unet" and stage == "backtrack":
            raise TrainError("a U-Net has no BT-net, so it has no backtrack stage", 2)
        try:
            self.vgg = None if vgg is None else networks.Vgg(vgg, settings["feature_style"])
        except KeyError as error:
            raise TrainError(f"{error} is missing in the weights of VGG-19", 4) from error
        self.networks = nn.ModuleDict()
        widths = self.vgg.widths() if self.vgg else []
        for name, outputs in (("separation", 6), ("backtrack", 3))[stage == "backtrack" :]:
            if settings["network"] == "generator":
                style, start = settings["feature_style"], settings["start"]
                self.networks[name] = networks.Generator(settings["width"], outputs, widths, start, style)
            elif name == "separation":
                self.networks[name] = networks.Unet(settings["width"])
        self.learned = dict(self.networks.named_parameters())
        if settings["adversarial_weight"] > 0:
            self.networks["discriminator"] = networks.Discriminator(settings["discriminator_width"])
        self.judging = {name: p for name, p in self.networks.named_parameters() if name not in self.learned}
        for module in (self.networks, self.vgg or nn.Module()):
            module.to(device)
            module.to(memory_format=torch.channels_last)
        self.means = {name: p.detach().clone() for name, p in self.learned.items()} if settings["ema"] > 0 else {}
        decay = settings["weight_decay"] if settings["optimizer"] == "adamw" else 0.0
        self.adam, self.judge_adam = self._adam(self.learned, decay), self._adam(self.judging, 0.0)
        self.steps, self.judge_steps = 0, 0

    def _adam(self, named: Mapping[str, nn.Parameter], decay: float) -> torch.optim.AdamW | None:
        if not named:
            return None
        adam = torch.optim.AdamW(named.values(), betas=tuple(self.settings["betas"]), weight_decay=decay)
        for p in named.values():
            moments = {"exp_avg": torch.zeros_like(p), "exp_avg_sq": torch.zeros_like(p)}
            adam.state[p] = {"step": torch.tensor(0.0), **moments}
        return adam

    def compile(self) -> None:
        """Compiles the networks with `torch.compile` at their first use."""
        for module in (*self.networks.values(), self.vgg or nn.Module()):
            module.compile()

    def model(self) -> Tensors:
        """Returns the weights for work by name: running means if the settings use them."""
        weights = {name: p.detach() for name, p in {**self.learned, **self.judging}.items()}
        return {**weights, **self.means}

    def moments(self) -> Tensors:
        """Returns `mean.NAME` and `square.NAME` of the optimisers and, with running means, `weight.NAME`."""
        made = {f"weight.{name}": p.detach() for name, p in self.learned.items() if self.means}
        for adam, named in ((self.adam, self.learned), (self.judge_adam, self.judging)):
            if adam:
                made |= {f"mean.{name}": adam.state[p]["exp_avg"] for name, p in named.items()}
                made |= {f"square.{name}": adam.state[p]["exp_avg_sq"] for name, p in named.items()}
        return made

    def load(self, model: Mapping[str, Any], moments: Mapping[str, Any] | None = None) -> None:
        """Copies weights (arrays or tensors by name), and moments if given; raises TrainError if they do not fit."""
        _copy(model, {name: p.detach() for name, p in {**self.learned, **self.judging}.items()})
        _copy(model, self.means)
        if moments is not None:
            _copy(moments, self.moments())

    def _run(self, network: nn.Module, *inputs: Any) -> Any:
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.precision == "bf16"):
            return network(*inputs)

    def features(self, images: Tensor) -> list[Tensor]:
        """Returns the features of images (batch, 3, rows, columns), finest first; none if the settings use none."""
        return list(self._run(self.vgg, images)) if self.vgg else []

    def separate(self, images: Tensor) -> tuple[Tensor, Tensor | None]:
        """Returns T* and R~*, not clamped, each (batch, 3, rows, columns); a U-Net has no R~*."""
        is_unet = self.settings["network"] == "unet"
        made = self._run(self.networks["separation"], images, [] if is_unet else self.features(images))
        bound = self.settings["bound"]
        t = networks.bounded(made[:, :3], images, bound) if bound > 0 else made[:, :3]
        return t, None if is_unet else made[:, 3:]

    def _compare(
        self, terms: Tensors, layer: str, made: Tensor, truth: Tensor, features: list[Tensor] | None = None
    ) -> None:
        """Adds the weighted terms of an output; `features` are those of the output, if known."""
        weights, difference = self.settings, made.float() - truth
        if weights["pixel_weight"] > 0:
            terms[f"{layer}_l1"] = weights["pixel_weight"] * difference.abs().mean()
        if weights["gradient_weight"] > 0:
            slopes = difference.diff(dim=3).abs().mean() + difference.diff(dim=2).abs().mean()
            terms[f"{layer}_gradient"] = weights["gradient_weight"] * slopes
        if weights["feature_weight"] > 0 and self.vgg:
            pairs = zip(features or self.features(made), self.features(truth), FEATURE_DIVISORS, strict=True)
            parts = [(a.float() - b.float()).abs().mean() / divisor for a, b, divisor in pairs]
            # caffe's features are of codes from 0 to 255.
            factor = 255 if weights["feature_style"] == "caffe" else 1
            terms[f"{layer}_feature"] = weights["feature_weight"] * factor * torch.stack(parts).sum()

    def _losses(self, batch: Mapping[str, Tensor]) -> tuple[Tensor, Tensor, Tensor, Tensors]:
        """Returns the discriminator's images (input, output, truth), and the terms of the loss without it."""
        terms: Tensors = {}
        glass, clean = batch.get("glass_reflection"), batch.get("clean_reflection")
        if self.stage == "backtrack":
            if glass is None or clean is None:
                raise TrainError("BT-net learns from glass_reflection and clean_reflection, which the examples lack", 4)
            made = self._run(self.networks["backtrack"], glass, self.features(glass))
            self._compare(terms, "clean_reflection", made, clean)
            return glass, made, clean, terms
        t, r = self.separate(batch["input"])
        self._compare(terms, "transmission", t, batch["transmission"])
        clean = clean if self.settings["a_priori"] else None
        if r is not None and (glass is not None or clean is not None):
            # BT-net and the comparison of R~* share these features.
            features = self.features(r)
            if glass is not None:
                self._compare(terms, "glass_reflection", r, glass, features)
            if clean is not None:
                tracked = self._run(self.networks["backtrack"], r, features)
                self._compare(terms, "clean_reflection", tracked, clean)
        return batch["input"], t, batch["transmission"], terms

    def step(self, step: int, batch: Mapping[str, Tensor]) -> Losses:
        """Trains one step, counted from 0: the discriminator if it is due, then the generators.

        `batch` has this process's share of the examples, float32 (batch, 3, rows, columns), by layer. The losses are
        means over all processes. Raises TrainError if the batch lacks layers or if the loss has no terms.
        """
        given, made, truth, terms = self._losses(batch)
        judged = []
        if self.judge_adam:
            judge = self.networks["discriminator"]
            if step % self.settings["discriminator_every"] == 0:
                judge.requires_grad_(True)
                real, fake = self._run(judge, given, truth), self._run(judge, given, made.detach())
                judged = [0.5 * (F.softplus(-real.float()).mean() + F.softplus(fake.float()).mean())]
                self.judge_steps += 1
                lr = rate(self.settings, step + 1, "discriminator_learning_rate")
                self._update(self.judge_adam, judged[0], self.judge_steps, lr)
            judge.requires_grad_(False)
            believed = F.softplus(-self._run(judge, given, made).float()).mean()
            terms["adversarial"] = self.settings["adversarial_weight"] * believed
        if not terms or not self.adam:
            raise TrainError("the loss has no terms: nothing can be learned", 2)
        total = torch.stack(list(terms.values())).sum()
        self.steps += 1
        self._update(self.adam, total, self.steps, rate(self.settings, step + 1))
        share = 1 - min(self.settings["ema"], self.steps / (self.steps + 20))
        for name, mean in self.means.items():
            mean.lerp_(self.learned[name].detach(), share)
        values = mean_of_processes(torch.stack([total, *terms.values(), *judged])).tolist()
        of_terms = dict(zip(terms, values[1:], strict=False))
        return Losses(values[0], of_terms, values[-1] if judged else None)

    def _update(self, adam: torch.optim.AdamW, loss: Tensor, steps: int, lr: float) -> None:
        """Takes the optimiser's step number `steps`; weights without a gradient do not change."""
        (group,) = adam.param_groups
        adam.zero_grad()
        torch.autograd.backward(loss)
        gradients: list[Tensor] = [p.grad for p in group["params"] if p.grad is not None]
        if process_count() > 1:
            flat = mean_of_processes(torch.cat([gradient.flatten() for gradient in gradients]))
            parts = torch.split(flat, [gradient.numel() for gradient in gradients])
            for gradient, part in zip(gradients, parts, strict=True):
                gradient.copy_(part.view(gradient.shape))
        if self.settings["clip_norm"] > 0:
            nn.utils.clip_grad_norm_(group["params"], self.settings["clip_norm"])
        group["lr"] = lr
        for state in adam.state.values():
            state["step"].fill_(steps - 1)
        adam.step()


def _copy(source: Mapping[str, Any], targets: Mapping[str, Tensor]) -> None:
    for name, target in targets.items():
        found = torch.as_tensor(source[name]) if name in source else None
        if found is None or found.shape != target.shape:
            what = "missing" if found is None else f"{tuple(found.shape)}, not {tuple(target.shape)}"
            raise TrainError(f"the weights do not fit the settings: {name} is {what}", 4)
        target.copy_(found)
