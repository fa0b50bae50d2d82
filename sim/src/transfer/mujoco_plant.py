"""One robot on one terrain in MuJoCo: a line of JSON in, a line of JSON out, until stdin ends.

  {"do": "open", "model", "substeps", "joints": [name], "feet": [geom], "base_shapes": [geom]}
      -> {"version", "mass_kg"}          the robot's MJCF as it is, its floor taken away
  {"do": "terrain", "solids": [box | grid]}             -> {}
      box:  {"box": {"centre_m", "half_extents_m"}}
      grid: {"grid": {"origin_m", "spacing_m", "rows", "columns", "heights_m"}}
  {"do": "place", "position_m", "orientation_xyzw", "joint_position_rad"}   -> state, at rest
  {"do": "vary", "friction", "base_mass_offset_kg"}     -> {}
  {"do": "push", "velocity_in_world"}                   -> state
  {"do": "step", "torque_nm"}                           -> state 5 ms later, torques held
  {"do": "heights", "points_m": [[x, y]]}               -> {"heights_m"}, null where nothing is hit
  {"do": "time_stand", "position_rad", "stiffness_nm_per_rad", "damping_nms_per_rad", "effort_nm",
   "settling_steps", "rounds", "steps"}                 -> {"step_us"}, on a copy: nothing moves
  {"do": "time_rollouts", the same, "rollouts", "threads"}   -> {"step_us"} of mujoco.rollout, likewise

state: {"joint_position_rad", "joint_velocity_rad_per_s", "position_m", "orientation_xyzw",
  "linear_in_world", "angular_in_base", "foot_contact", "base_contact", "nonfoot_contact"}, or
  {"diverged": true}. Joints are in the order of "joints", feet in that of "feet"; contacts are those
that press in the last substep. What cannot be done is answered with {"error": text}.

Drives are the caller's: torques arrive as they are applied.
"""

import copy
import json
import sys
import time

STEP_S = 0.005
TERRAIN_GROUP = 5
TERRAIN, LIMB, BASE = -3, -2, -1


class Plant:
    def __init__(self, request):
        self.request = request
        self.substeps = request["substeps"]
        self.build([])

    def build(self, solids):
        """The robot's file with `solids` for its floor."""
        spec = mujoco.MjSpec.from_file(self.request["model"])
        for geom in list(spec.worldbody.geoms):
            spec.delete(geom)
        for number, solid in enumerate(solids):
            # The larger friction of the two counts: nothing here leaves it to the robot.
            ground = {"name": f"terrain_{number}", "friction": [0, 0, 0], "group": TERRAIN_GROUP}
            if "box" in solid:
                box = solid["box"]
                spec.worldbody.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_BOX, pos=box["centre_m"], size=box["half_extents_m"], **ground
                )
            else:
                self.add_grid(spec, solid["grid"], ground)
        model = spec.compile()
        model.opt.timestep = STEP_S / self.substeps
        # A state that is not a number must come out as such.
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.adopt(model)

    @staticmethod
    def add_grid(spec, grid, ground):
        """A grid has rows along x and cells split from (row + 1, column) to (row, column + 1). MuJoCo's
        columns lie along its x and its cells are split the other way: a quarter turn mends both."""
        rows, columns, spacing_m = grid["rows"], grid["columns"], grid["spacing_m"]
        heights_m = numpy.array(grid["heights_m"]).reshape(rows, columns)[::-1]
        low_m, relief_m = heights_m.min(), max(heights_m.max() - heights_m.min(), 1e-6)
        half_m = [0.5 * spacing_m * (rows - 1), 0.5 * spacing_m * (columns - 1)]
        spec.add_hfield(
            name=ground["name"], nrow=rows, ncol=columns, size=[half_m[1], half_m[0], relief_m, 1.0],
            userdata=((heights_m - low_m) / relief_m).ravel(),
        )
        origin_m = grid["origin_m"]
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname=ground["name"], quat=[0.5**0.5, 0, 0, 0.5**0.5],
            pos=[origin_m[0] + half_m[0], origin_m[1] + half_m[1], low_m], **ground,
        )

    def adopt(self, model):
        request = self.request
        self.model, self.data, self.scratch = model, mujoco.MjData(model), mujoco.MjData(model)
        joints = [model.joint(name) for name in request["joints"]]
        self.positions = numpy.array([joint.qposadr[0] for joint in joints])
        self.velocities = numpy.array([joint.dofadr[0] for joint in joints])
        mujoco.mj_forward(model, self.data)
        # Every body but the world is the robot's.
        self.robot_geoms = numpy.flatnonzero(model.geom_bodyid > 0)
        self.roles = [TERRAIN if body == 0 else LIMB for body in model.geom_bodyid]
        for name in request["base_shapes"]:
            self.roles[model.geom(name).id] = BASE
        for number, name in enumerate(request["feet"]):
            self.roles[model.geom(name).id] = number
        self.base = int(model.geom_bodyid[model.geom(request["base_shapes"][0]).id])
        self.base_mass_kg = float(model.body_mass[self.base])
        self.base_inertia = model.body_inertia[self.base].copy()

    def terrain(self, solids):
        self.build(solids)
        return {}

    def place(self, position_m, orientation_xyzw, joint_position_rad):
        mujoco.mj_resetData(self.model, self.data)
        x, y, z, w = orientation_xyzw
        self.data.qpos[:7] = [*position_m, w, x, y, z]
        self.data.qpos[self.positions] = joint_position_rad
        mujoco.mj_forward(self.model, self.data)
        return self.state()

    def vary(self, friction, base_mass_offset_kg):
        model = self.model
        model.geom_friction[self.robot_geoms, 0] = friction
        mass_kg = self.base_mass_kg + base_mass_offset_kg
        model.body_mass[self.base] = mass_kg
        model.body_inertia[self.base] = self.base_inertia * (mass_kg / self.base_mass_kg)
        # Needs data that it may overwrite.
        mujoco.mj_setConst(model, self.scratch)
        return {}

    def push(self, velocity_in_world):
        self.data.qvel[:3] += velocity_in_world
        return self.state()

    def step(self, torque_nm):
        self.data.qfrc_applied[self.velocities] = torque_nm
        mujoco.mj_step(self.model, self.data, self.substeps)
        return self.state()

    def heights(self, points_m):
        groups = numpy.array([group == TERRAIN_GROUP for group in range(6)], dtype=numpy.uint8)
        hit = numpy.zeros(1, dtype=numpy.int32)
        down, top_m = numpy.array([0.0, 0.0, -1.0]), 10.0
        heights_m = []
        for x, y in points_m:
            start = numpy.array([x, y, top_m])
            depth_m = mujoco.mj_ray(self.model, self.data, start, down, groups, 1, -1, hit)
            heights_m.append(top_m - depth_m if depth_m >= 0 else None)
        return {"heights_m": heights_m}

    def standing(self, position_rad, stiffness_nm_per_rad, damping_nms_per_rad, effort_nm, settling_steps):
        """A copy that steps by STEP_S and stands still, motors as position servos."""
        model, data = copy.copy(self.model), copy.copy(self.data)
        model.opt.timestep = STEP_S
        model.actuator_gaintype[:] = mujoco.mjtGain.mjGAIN_FIXED
        model.actuator_biastype[:] = mujoco.mjtBias.mjBIAS_AFFINE
        model.actuator_gainprm[:, 0] = stiffness_nm_per_rad
        model.actuator_biasprm[:, :3] = [0, -stiffness_nm_per_rad, -damping_nms_per_rad]
        model.actuator_ctrllimited[:] = 0
        model.actuator_forcelimited[:] = 1
        model.actuator_forcerange[:] = [-effort_nm, effort_nm]
        wanted_rad = {model.joint(name).id: at for name, at in zip(self.request["joints"], position_rad)}
        data.ctrl[:] = [wanted_rad[joint] for joint in model.actuator_trnid[:, 0].tolist()]
        mujoco.mj_step(model, data, settling_steps)
        return model, data

    def check_standing(self, height_m):
        start_m = self.data.qpos[2]
        if not abs(height_m - start_m) < 0.1:
            raise ValueError(f"found the base at {height_m:.3f} m, wanted it standing near {start_m:.3f} m")

    def time_stand(self, rounds, steps, **stand):
        """Mean time of a step of STEP_S in the fastest round."""
        model, data = self.standing(**stand)
        fastest_s = numpy.inf
        for _ in range(rounds):
            start_s = time.perf_counter()
            mujoco.mj_step(model, data, steps)
            fastest_s = min(fastest_s, time.perf_counter() - start_s)
        self.check_standing(data.qpos[2])
        return {"step_us": 1e6 * fastest_s / steps}

    def time_rollouts(self, rounds, steps, rollouts, threads, **stand):
        """Wall time for a step of STEP_S in the fastest round of as many rollouts, all threads at work."""
        from mujoco import rollout

        model, data = self.standing(**stand)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        start = numpy.empty(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, start, kind)
        starts, control = numpy.tile(start, (rollouts, 1)), data.ctrl.reshape(1, 1, -1).copy()
        workspaces = [copy.copy(data) for _ in range(threads)]
        fastest_s = numpy.inf
        with rollout.Rollout(nthread=threads) as pool:
            for _ in range(rounds):
                start_s = time.perf_counter()
                states, _ = pool.rollout(model, workspaces, starts, control, nstep=steps)
                fastest_s = min(fastest_s, time.perf_counter() - start_s)
        # Behind the time comes the position.
        self.check_standing(states[-1, -1, 3])
        return {"step_us": 1e6 * fastest_s / (steps * rollouts)}

    def state(self):
        data = self.data
        if not (numpy.isfinite(data.qpos).all() and numpy.isfinite(data.qvel).all()):
            return {"diverged": True}
        foot_contact = [False] * len(self.request["feet"])
        base_contact = nonfoot_contact = False
        for contact in data.contact:
            # The first row of a contact is its normal force.
            row = contact.efc_address
            if row < 0 or data.efc_force[row] <= 0.0:
                continue
            sides = [self.roles[geom] for geom in contact.geom]
            for side in sides:
                if side >= 0:
                    foot_contact[side] |= TERRAIN in sides
                elif side != TERRAIN:
                    nonfoot_contact = True
                    base_contact |= side == BASE
        w, x, y, z = data.qpos[3:7].tolist()
        return {
            "joint_position_rad": data.qpos[self.positions].tolist(),
            "joint_velocity_rad_per_s": data.qvel[self.velocities].tolist(),
            "position_m": data.qpos[:3].tolist(),
            "orientation_xyzw": [x, y, z, w],
            "linear_in_world": data.qvel[:3].tolist(),
            "angular_in_base": data.qvel[3:6].tolist(),
            "foot_contact": foot_contact,
            "base_contact": base_contact,
            "nonfoot_contact": nonfoot_contact,
        }


def answers(lines):
    plant = None
    for line in lines:
        request = json.loads(line)
        action = request.pop("do")
        if action == "open":
            plant = Plant(request)
            yield {"version": mujoco.__version__, "mass_kg": float(plant.model.body_mass.sum())}
        else:
            yield getattr(plant, action)(**request)


def say(answer):
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


def main():
    try:
        for answer in answers(sys.stdin):
            say(answer)
    except Exception as error:
        say({"error": f"{type(error).__name__}: {error}"})


try:
    import mujoco
    import numpy
except ImportError as error:
    say({"missing": str(error)})
else:
    # Left alone, MuJoCo writes a log file wherever it runs.
    mujoco.set_mju_user_warning(lambda message: None)
    main()
