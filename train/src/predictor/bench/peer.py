# Fits the method's network, with a sigmoid behind it, in PyTorch. One argument, JSON: folder, shapes of
# the parameters, batch, threads, learning_rate, momentum. The folder holds fields.f32 [n][31][11],
# labels.f32 [n], start.f32 (all parameters, flat) and order.u64 (rows, epoch after epoch). Writes the
# first batch's gradient as gradient.f32 and prints one line: {"version", "seconds", "losses"}, or
# {"missing": why}.
import json
import os
import sys
import time

task = json.loads(sys.argv[1])
try:
    import numpy
    import torch
except (ImportError, OSError, ValueError) as error:
    print(json.dumps({"missing": str(error).splitlines()[0]}))
    sys.exit()

torch.set_num_threads(task["threads"])


def read(name, kind):
    return torch.from_numpy(numpy.fromfile(os.path.join(task["folder"], name), dtype=kind))


fields = read("fields.f32", "<f4").reshape(-1, 1, 31, 11)
labels = read("labels.f32", "<f4").reshape(-1, 1)
orders = read("order.u64", "<i8").reshape(-1, len(fields))
network = torch.nn.Sequential(
    torch.nn.Conv2d(1, 4, 3, padding=1),
    torch.nn.ReLU(),
    torch.nn.Conv2d(4, 8, 3, padding=1),
    torch.nn.ReLU(),
    torch.nn.MaxPool2d(2),
    torch.nn.Conv2d(8, 8, 3, padding=1),
    torch.nn.ReLU(),
    torch.nn.Flatten(),
    torch.nn.Linear(600, 128),
    torch.nn.ReLU(),
    torch.nn.Linear(128, 128),
    torch.nn.ReLU(),
    torch.nn.Linear(128, 1),
    torch.nn.Sigmoid(),
)
start = read("start.f32", "<f4")
at = 0
with torch.no_grad():
    for parameter, shape in zip(network.parameters(), task["shapes"], strict=True):
        count = parameter.numel()
        parameter.copy_(start[at : at + count].reshape(shape))
        at += count
loss_of = torch.nn.MSELoss()
optimiser = torch.optim.SGD(
    network.parameters(), lr=task["learning_rate"], momentum=task["momentum"]
)


def loss(rows):
    optimiser.zero_grad()
    value = loss_of(network(fields[rows]), labels[rows])
    value.backward()
    return value


loss(orders[0, : task["batch"]])
gradient = torch.cat([parameter.grad.flatten() for parameter in network.parameters()])
gradient.numpy().astype("<f4").tofile(os.path.join(task["folder"], "gradient.f32"))
losses = []
began = time.perf_counter()
for order in orders:
    total = torch.zeros(())
    for rows in order.split(task["batch"]):
        value = loss(rows)
        optimiser.step()
        total += value.detach() * len(rows)
    losses.append(float(total) / len(order))
seconds = time.perf_counter() - began
print(json.dumps({"version": torch.__version__, "seconds": seconds, "losses": losses}))
