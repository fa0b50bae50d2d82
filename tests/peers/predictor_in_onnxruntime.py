"""Predictor files in Python's onnx and onnxruntime: one JSON request on stdin, one JSON answer on stdout.

Request: {"models": [path], "fields": [[341 heights, metres, row-major 31 x 11]]}
Answer: {"onnx", "onnxruntime", "outputs": {path: [value of each field]}}
Each model passes onnx's full check, runs on all fields as one batch and on the first alone.
"""

import json
import sys

import numpy
import onnx
import onnxruntime

request = json.load(sys.stdin)
fields = numpy.array(request["fields"], dtype=numpy.float32).reshape(-1, 1, 31, 11)
outputs = {}
for path in request["models"]:
    onnx.checker.check_model(path, full_check=True)
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    (batch,) = session.run(None, {"heightfield": fields})
    (alone,) = session.run(None, {"heightfield": fields[:1]})
    assert batch.shape == (len(fields), 1), batch.shape
    assert abs(float(batch[0, 0]) - float(alone[0, 0])) < 1e-5, (batch[0, 0], alone[0, 0])
    outputs[path] = [float(value) for value in batch[:, 0]]
json.dump({"onnx": onnx.__version__, "onnxruntime": onnxruntime.__version__, "outputs": outputs}, sys.stdout)
