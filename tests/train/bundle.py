"""Makes bundle/model.{index,data-00000-of-00001} and bundle.safetensors for tests/train/bundle.rs.

    pip install tensorflow-cpu==2.15.1 tf_keras==2.15.1 tf_slim safetensors; python3 tests/train/bundle.py

A checkpoint with random weights of the graph in main.py of sookim813/Reflection_removal_rendering, built by the same calls
of slim (so that slim names the variables), and the outputs of this graph for the image of step.safetensors. The networks are narrow:
width 6, and the VGG-19 of step.safetensors, whose widths are those published divided by 32.
"""

import importlib
import os
import pathlib
import sys

os.environ["CUDA_VISIBLE_DEVICES"] = ""
# TensorFlow 2.15 looks for the layers of slim at their former place.
sys.modules["tf_keras.legacy_tf_layers"] = importlib.import_module("tf_keras.src.legacy_tf_layers")
import numpy as np
import tensorflow.compat.v1 as tf
import tf_slim as slim
from safetensors.numpy import load_file, save_file

FOLDER = pathlib.Path(__file__).parent
GIVEN = load_file(FOLDER / "step.safetensors")
WIDTH, SIDE = 6, 32
PLACES = [0, 2, 5, 7, 10, 12, 14, 16, 19, 21, 23, 25, 28, 30]
TAPS, POOLS = [1, 3, 5, 9, 13], [2, 4, 8, 12]


def vgg(x):
    x = x - np.array([123.68, 116.779, 103.939], np.float32).reshape(1, 1, 1, 3)
    taps = []
    for index, place in enumerate(PLACES):
        if index in POOLS:
            x = tf.nn.avg_pool2d(x, 2, 2, "SAME")
        kernel = GIVEN[f"features.{place}.weight"].transpose(2, 3, 1, 0)
        x = tf.nn.relu(tf.nn.conv2d(x, kernel, 1, "SAME") + GIVEN[f"features.{place}.bias"])
        if index in TAPS:
            taps.append(x)
    return taps


def norm(x):
    w0 = tf.Variable(1.0, name="w0")
    w1 = tf.Variable(0.0, name="w1")
    return w0 * x + w1 * slim.batch_norm(x)


def generator(x, outputs):
    size = tf.shape(x)[1:3]
    for tap in vgg(x * 255.0):
        x = tf.concat([tf.image.resize_bilinear(tap, size) / 255.0, x], axis=3)
    leaky = lambda x: tf.maximum(x * 0.2, x)
    for number, (side, rate) in zip([0, 1, 2, 3, 4, 5, 6, 7, 9], [(1, 1), *((3, 2**k) for k in range(7)), (3, 1)]):
        x = slim.conv2d(x, WIDTH, [side, side], rate=rate, activation_fn=leaky, normalizer_fn=norm, scope=f"g_conv{number}")
    return slim.conv2d(x, outputs, [1, 1], activation_fn=None, scope="g_conv_last")


tf.disable_eager_execution()
image = tf.placeholder(tf.float32, [None, None, None, 3])
made = generator(image, 6)
with tf.variable_scope("R_reconnet"):
    clean = generator(made[..., 3:], 3)
# The optimiser's variables are in published checkpoints, too.
train = tf.train.AdamOptimizer(2e-4).minimize(tf.reduce_mean(clean))

rng = np.random.default_rng(18)
rgb = GIVEN["image.input"][:, :, :SIDE, :SIDE]
with tf.Session() as session:
    session.run(tf.global_variables_initializer())
    for variable in tf.trainable_variables():
        shape = variable.shape.as_list()
        scale = (2 / max(1, np.prod(shape[:-1]))) ** 0.5 if len(shape) == 4 else 0.2
        value = rng.normal(0, scale, shape).astype(np.float32)
        value += 1.0 if variable.name.endswith("w0:0") else 0.0
        variable.load(value, session)
    saver = tf.train.Saver()
    (FOLDER / "bundle").mkdir(exist_ok=True)
    saver.save(session, str(FOLDER / "bundle/model"), write_meta_graph=False)
    bgr = rgb[:, ::-1].transpose(0, 2, 3, 1)
    outputs = session.run([made[..., :3], made[..., 3:], clean], {image: bgr})
(FOLDER / "bundle/checkpoint").unlink()
names = ["transmission", "glass_reflection", "clean_reflection"]
outputs = {name: np.ascontiguousarray(v.transpose(0, 3, 1, 2)[:, ::-1]) for name, v in zip(names, outputs)}
save_file({"image": np.ascontiguousarray(rgb), **outputs}, FOLDER / "bundle.safetensors")
for name, value in outputs.items():
    print(name, value.shape, float(np.abs(value).mean()))
print(sorted(v.name for v in tf.global_variables())[:12])
