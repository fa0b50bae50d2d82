"""The robot file in MuJoCo, unmodified: one JSON request on stdin, one JSON answer on stdout.

Request: {"model": path, "runs": [{"name", "height_m", "joint_position_rad": {joint: rad},
  "substeps": int, "torque_nm": [[12]] | "target_rad": [[12]], "stiffness", "damping",
  "effort_nm", "saturation_nm", "velocity_limit_rad_per_s"}]}
Joints of torques and targets are in the file's order; one row is held for 5 ms.
Answer: {"version", "mass_kg", "bodies", "joints": [{"name", "lower_rad", "upper_rad",
  "armature_kg_m2"}], "runs": {name: {"joint_position_rad": [[12]], "base_position_m": [[3]]}}}
"""

import json
import sys

import mujoco

STEP_S = 0.005


def limit(torque, velocity, run):
    """The drive's torque-speed limits, as docs/method.md, gives them."""
    bound = run["effort_nm"]
    if torque * velocity > 0.0:
        line = run["saturation_nm"] * (1.0 - abs(velocity) / run["velocity_limit_rad_per_s"])
        bound = min(max(line, 0.0), bound)
    return min(max(torque, -bound), bound)


def simulate(model, run):
    model.opt.timestep = STEP_S / run["substeps"]
    data = mujoco.MjData(model)
    data.qpos[2] = run["height_m"]
    for name, position in run["joint_position_rad"].items():
        data.joint(name).qpos[0] = position
    # Joint 0 is the base's free joint: 7 positions, 6 velocities.
    mujoco.mj_forward(model, data)
    positions, bases = [], []
    for row in run.get("torque_nm") or run["target_rad"]:
        if "torque_nm" in run:
            torques = row
        else:
            torques = [
                limit(run["stiffness"] * (target - q) - run["damping"] * v, v, run)
                for target, q, v in zip(row, data.qpos[7:], data.qvel[6:])
            ]
        data.qfrc_applied[6:] = torques
        for _ in range(run["substeps"]):
            mujoco.mj_step(model, data)
        positions.append(list(data.qpos[7:]))
        bases.append(list(data.qpos[:3]))
    return {"joint_position_rad": positions, "base_position_m": bases}


def main():
    request = json.load(sys.stdin)
    model = mujoco.MjModel.from_xml_path(request["model"])
    hinges = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]
    answer = {
        "version": mujoco.__version__,
        "mass_kg": float(sum(model.body_mass)),
        "bodies": int(model.nbody) - 1,
        "joints": [
            {
                "name": model.joint(j).name,
                "lower_rad": float(model.jnt_range[j][0]),
                "upper_rad": float(model.jnt_range[j][1]),
                "armature_kg_m2": float(model.dof_armature[model.jnt_dofadr[j]]),
            }
            for j in hinges
        ],
        "runs": {run["name"]: simulate(model, run) for run in request["runs"]},
    }
    json.dump(answer, sys.stdout)


if __name__ == "__main__":
    main()
