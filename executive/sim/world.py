"""The simulated world: stepping, observation, snapshots, and disturbances by faults."""

from __future__ import annotations

import ast
import heapq
import io
import itertools
import weakref
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from types import MappingProxyType

import mujoco
import numpy as np

from executive.errors import DomainError, InputError
from executive.sim import disturbances, photoreal, placement, scene, unknown
from executive.sim import viewer_geometry as scenery
from executive.sim.cameras import Cameras
from executive.sim.drawers import Drawers
from executive.sim.robot_api import ArmLimits, Handle, PoseSource
from executive.sim.spec import SceneSpec, read_scene
from executive.types import FloatArray, Frame, Image, Observation, PosesEstimated, Scenery, Watched
from executive.util.arrays import parse_arrays
from executive.util.requirements import give_back_memory
from executive.util.timeout import exclusive

CONTROL_PERIOD = 0.008
"""125 Hz, the rate of the UR controllers."""

FRAME_PERIOD = 0.1
"""Seconds of the world's time between two frames for the viewer, unless someone asks for more."""

RATED_VELOCITY = np.full(6, np.pi)
"""The UR5e's rated joint velocity, 180 degrees/s for every joint (its data sheet)."""

RATED_ACCELERATION = np.full(6, 8.0)
"""rad/s^2. The data sheet gives none; this keeps the servos well within their torque limits."""
RATED_JERK = np.full(6, 200.0)
"""rad/s^3. No data sheet gives one either; with this, the full acceleration is there after 40 ms."""

_NEWS = 0.005
"""m by which something that is filmed has to be elsewhere for those who watch to be told again."""

_HAND_OVER = 0.6
"""Seconds for which an item is held in place while the fingers close on it."""

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_NOT_WRITTEN_HERE = (
    *(ValueError, LookupError, TypeError, AttributeError, OverflowError),
    *(SyntaxError, RecursionError, MemoryError),  # of literals that are none
)


class MujocoWorld:
    """A scene with a robot and the items of one problem, drawn by seed.

    Args:
        file: the domain's `scene.toml`.
        objects: the problem's objects, name -> type; every one needs a body in the scene.
        seed: fixes where the items stand and every error of perception.
        placed: item -> table, drawer or container for the items whose place the problem declares.
        barred: item -> tables on which it does not stand, and drawers in which it is not.
        opened: drawer -> whether it is open, for those of which the problem declares that.
        held: the item that the hand holds at the beginning, by contact and friction as ever.
        grasp_noise: standard deviation in m of the horizontal error with which a grasped item's pose is known.
        home_pose: whether skills end at the home pose.
        blockings: how often a table is going to be blocked; that many times the boxes for it wait out of sight.
        keep_trees: whether skills report the search trees of their motions.
        first_observation: the number of the first look.
        depth: whether looks have the depth pictures of the cameras that measure depth.
        stacked: item -> the item that it stands on.
        regions: item -> the region that it is in.
        renderer: what draws all cameras' pictures, in place of what the scene says.

    Raises:
        DomainError: the scene file is wrong, an object has no body, the items find no place, or the hand cannot hold
            what it is to hold.
        MissingError: robosuite or an off-screen OpenGL is missing.
    """

    def __init__(
        self,
        file: Path,
        objects: Mapping[str, str],
        seed: int = 0,
        placed: Mapping[str, str] | None = None,
        grasp_noise: float = 0.0,
        home_pose: bool = True,
        blockings: int = 0,
        keep_trees: bool = False,
        first_observation: int = 0,
        barred: Mapping[str, Collection[str]] = MappingProxyType({}),
        held: str | None = None,
        depth: bool = False,
        stacked: Mapping[str, str] = MappingProxyType({}),
        regions: Mapping[str, str] = MappingProxyType({}),
        renderer: str | None = None,
        opened: Mapping[str, bool] = MappingProxyType({}),
    ) -> None:
        spec = read_scene(file).restricted_to(objects, file).with_drawers(opened)
        if renderer is not None:
            cameras = tuple(camera.model_copy(update={"renderer": renderer}) for camera in spec.cameras)
            spec = spec.model_copy(update={"cameras": cameras})
        if any(camera.renderer == "mitsuba" for camera in spec.cameras):
            photoreal.require()
        self.items = tuple(item.name for item in spec.items)
        added = disturbances.boxes(spec, blockings)
        self.boxes = tuple(box.name for box in added)
        self.spec: SceneSpec = spec.model_copy(update={"items": (*spec.items, *added)})
        self.model = compiled(self.spec, file)
        self.data = mujoco.MjData(self.model)
        self.shapes = scene.item_shapes(self.model, self.spec)
        self.drawers = Drawers({drawer.name: drawer for drawer in self.spec.drawers}, self.model, self.data)
        self._placement_rng, self._noise_rng = (
            np.random.default_rng(child) for child in np.random.SeedSequence([seed, 0x5EED]).spawn(2)
        )
        self._grasp_noise = grasp_noise
        self._misplaced: FloatArray | None = None
        self._forced_open_until = -1.0
        self.localizer: PoseSource | None = None
        """What `locate` and `obstacles` answer from; without it, they tell where everything is."""
        self.frame_period = FRAME_PERIOD
        """Seconds of the world's time from one frame to the next for those who watch."""
        self.film_period = 0.0
        """Seconds of the world's time from one estimate of the localizer to the next while the world moves; 0: poses
        are estimated when somebody asks."""
        self._next_film = 0.0
        self._told: PosesEstimated | None = None
        self._estimate: PosesEstimated | None = None
        self._scheduled: list[tuple[float, int, Callable[[], None]]] = []
        self._ids = itertools.count()
        self._listener: Callable[[Watched], None] | None = None
        self._next_frame = 0.0
        self._observations = itertools.count(first_observation)
        self.cameras = Cameras(self.model, self.data, self.spec, seed, depth)
        self._steps = max(1, round(CONTROL_PERIOD / self.spec.timestep))
        self._arm = np.array([self.model.joint(name).qposadr[0] for name in scene.JOINTS])
        self._servo = np.array([self.model.actuator(name).id for name in scene.JOINTS])
        self._lag = np.array([damping / stiffness for stiffness, damping in scene.SERVO])
        self._fingers = np.array([self.model.actuator(name).id for name in scene.FINGER_DRIVES])
        self._finger_joints = np.array([self.model.joint(name).qposadr[0] for name in scene.FINGER_JOINTS])
        self._pads = [self.model.geom(name).id for name in scene.PADS]
        self._places = {item.name: self.model.joint(f"{item.name}/free").qposadr[0] for item in self.spec.items}
        limits = self._limits(file)
        self._reset(dict(placed or {}), file, barred, held, stacked, regions)
        spare = unknown.boxes() if depth else ()
        stage = self.spec.model_copy(update={"items": (*self.spec.items, *spare)})
        # The handle refers back weakly: a world holds a hundred megabytes, which go when its owner lets go of it.
        self.handle = Handle(
            limits=limits,
            tables={table.name: table for table in self.spec.tables},
            shapes=self.shapes | unknown.shapes(spare),
            regions={region.name: region for region in self.spec.regions},
            containers={container.name: container for container in self.spec.containers},
            drawers=self.drawers.specs,
            unknown=frozenset(self.boxes).union(box.name for box in spare),
            camera_positions={camera.name: np.array(camera.position) for camera in self.spec.cameras},
            planning_spec=lambda: scene.build(stage, visuals=False),
            control_period=self._steps * self.model.opt.timestep,
            home_pose=home_pose,
            body=weakref.proxy(self),
            keep_trees=keep_trees,
        )

    # executive.protocols.Simulator

    @property
    def time(self) -> float:
        return float(self.data.time)

    def observe(self, cause: str = "", cameras: Collection[str] | None = None) -> Observation:
        number = next(self._observations)
        images, depth = self.cameras.look(number, cameras)
        return Observation(number, self.time, images, self.joints(), cause, noisy=True, depth=depth)

    def sense(self) -> Observation:
        """What the cameras that measure depth sense now: a look that has no number, for estimating poses."""
        images, depth = self.cameras.sense()
        return Observation(-1, self.time, images, self.joints(), "poses", depth=depth)

    def move_camera(self, camera: str, by: FloatArray) -> None:
        """Have a camera stand `by` (3,) m, in the world's frame, from where the scene says, and everybody believes."""
        self.cameras.move(camera, by)

    def stop(self) -> None:
        """The servos hold the arm where it was last commanded to be, and time only passes while a skill drives it."""

    def render(self, camera: str) -> Image:
        """One camera's picture without noise, (H, W, 3) uint8."""
        return self.cameras.picture(camera)

    def masks(self) -> dict[str, Image]:
        """Which item each pixel of each camera shows, (H, W) uint8: from 1 on in the order of `items`, 0 for none."""
        return self.cameras.masks(self.items)

    def prepare(self, tell: Callable[[str], None]) -> None:
        """Make the renderer of photorealistic pictures ready, if a camera has them; `tell` receives what one costs."""
        drawn = [camera for camera in self.spec.cameras if camera.renderer == "mitsuba"]
        if drawn:
            tell("the scene for Mitsuba")
            self.render(drawn[0].name)
            drawing = self.cameras.drawing.photoreal()
            drawing.forget_cost()  # the first one takes longer
            self.render(drawn[0].name)
            tell(f"the scene for {drawing.cost}")

    def warm_up(self, handle: object) -> None:
        """Have the renderers made, in the thread that draws."""
        self.cameras.drawing.warm_up([camera for camera in self.spec.cameras if camera.renderer != "mitsuba"])

    def snapshot(self) -> bytes:
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        misplaced = np.full(3, np.nan) if self._misplaced is None else self._misplaced
        buffer = io.BytesIO()
        np.savez(
            buffer,
            state=state,
            closed=self._closed,
            misplaced=misplaced,
            forced_open_until=self._forced_open_until,
            drawers=self.drawers.state,
            rng=np.frombuffer(
                repr([g.bit_generator.state for g in (self._placement_rng, self._noise_rng)]).encode(), np.uint8
            ),
        )
        return buffer.getvalue()

    def copy_state(self, data: mujoco.MjData) -> None:
        """Have other data of this world's model be in its state."""
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        mujoco.mj_setState(self.model, data, state, _STATE)

    def restore(self, snapshot: bytes) -> None:
        """Continue from a snapshot. What was scheduled for later is forgotten.

        Raises:
            InputError: the bytes are no snapshot of this scene.
        """
        try:
            saved = parse_arrays(snapshot)
            state, misplaced = saved["state"], saved["misplaced"].astype(float).reshape(3)
            closed, forced = float(saved["closed"]), float(saved["forced_open_until"])
            drawers = saved["drawers"].astype(float) if self.drawers.specs else np.zeros(0)
            generators = [np.random.default_rng(0), np.random.default_rng(0)]
            states = ast.literal_eval(saved["rng"].tobytes().decode())
            for generator, state_of_it in zip(generators, states, strict=True):
                generator.bit_generator.state = state_of_it
        except _NOT_WRITTEN_HERE as error:
            raise InputError(f"not a snapshot of a world: {error}") from None
        if state.shape != (mujoco.mj_stateSize(self.model, _STATE),):
            raise InputError("the snapshot is of another scene: its state has another size")
        if drawers.shape != self.drawers.state.shape or np.isnan(drawers).any():
            raise InputError("the snapshot is of another scene: it has other drawers")
        if state.dtype != np.float64 or not np.isfinite([*state, closed, forced]).all():
            raise InputError("not a snapshot of a world: it has no numbers where they belong")
        mujoco.mj_setState(self.model, self.data, state, _STATE)
        mujoco.mj_forward(self.model, self.data)
        self._placement_rng, self._noise_rng = generators
        self.drawers.state = drawers
        self._misplaced = None if np.isnan(misplaced).any() else misplaced
        self._forced_open_until, self._closed = forced, closed
        self._scheduled.clear()
        self._next_frame = self._next_film = self.time

    def schedule(self, delay: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._scheduled, (self.time + delay, next(self._ids), action))

    def scenery(self) -> Scenery:
        return scenery.of(self.model, self.spec)

    def watch(self, listener: Callable[[Watched], None] | None) -> None:
        self._listener = listener
        self._next_frame = self._next_film = self.time

    def disturb(self, kind: str, rng: np.random.Generator, **arguments: str) -> str:
        return disturbances.disturb(self, kind, rng, arguments)

    # What a skill drives (executive.sim.robot_api.Body). What changes something is whole: a skill whose time is up is
    # left behind in its thread, and must not move anything while the loop goes on.

    def joints(self) -> FloatArray:
        return np.array(self.data.qpos[self._arm])

    def gripper_joints(self) -> FloatArray:
        return np.array(self.data.qpos[self._finger_joints])

    def gripper_width(self) -> float:
        left, right = (self.data.geom_xpos[pad] for pad in self._pads)
        return max(0.0, float(np.linalg.norm(left - right)) - 2 * scene.PAD_HALF_THICKNESS)

    @exclusive()
    def locate(self, item: str) -> FloatArray | None:
        if self.localizer is None:
            pose = self.pose(item)
        else:
            self._estimate = self._localized(self.localizer)
            if item not in self._estimate.poses:
                return None
            pose = np.array(self._estimate.poses[item].pose)
        return self._mislocated(pose)

    def _mislocated(self, pose: FloatArray) -> FloatArray:
        """A position (3,) or a pose (7,) as it is known where one of its own is to be grasped."""
        pose[:2] += self._noise_rng.normal(0.0, 1.0, 2) * self._grasp_noise
        if self._misplaced is not None:
            pose[:3] += self._misplaced
            self._misplaced = None
        return pose

    @exclusive()
    def obstacles(self) -> dict[str, FloatArray]:
        if self.localizer is None:
            return self.poses()
        self._estimate = self._localized(self.localizer)
        found = {item: np.array(estimate.pose) for item, estimate in self._estimate.poses.items()}
        return found | unknown.covered(self._estimate.lumps)

    @exclusive()
    def openings(self) -> dict[str, float]:
        if self.localizer is None or not self.drawers.specs:
            return self.drawers.openings()
        self._estimate = self._localized(self.localizer)
        return {name: self._estimate.openings.get(name, 0.0) for name in self.drawers.specs}

    @exclusive()
    def locate_handle(self, drawer: str) -> FloatArray:
        opening = self.openings()[drawer]
        return self._mislocated(self.drawers.specs[drawer].bar(opening))

    def estimated_poses(self) -> PosesEstimated | None:
        return self._estimate

    @exclusive()
    def hiders(self, item: str, spots: FloatArray) -> tuple[str, ...]:
        return () if self.localizer is None else self.localizer.hiders(item, spots)

    @exclusive()
    def command(self, position: FloatArray, velocity: FloatArray) -> None:
        # A position servo with damping lags a moving target by damping/stiffness seconds; lead by as much.
        self.data.ctrl[self._servo] = position + self._lag * velocity

    def mislead(self, error: FloatArray) -> None:
        """Adds `error` (3,), in m, to the next located pose."""
        self._misplaced = error

    def force_open(self, seconds: float) -> None:
        """Opens the fingers for a while, whatever they are commanded."""
        self._forced_open_until = self.time + seconds

    @exclusive()
    def command_gripper(self, closed: float) -> None:
        self._closed = float(np.clip(closed, 0.0, 1.0))

    @exclusive()
    def advance(self) -> None:
        while self._scheduled and self._scheduled[0][0] <= self.time:
            heapq.heappop(self._scheduled)[2]()
        closed = 0.0 if self.time < self._forced_open_until else self._closed
        self.data.ctrl[self._fingers] = closed * scene.FINGER_CLOSED
        self.drawers.before_step()
        mujoco.mj_step(self.model, self.data, self._steps)
        if self._listener is not None and self.time >= self._next_frame:
            # From the moment that it was due: what is late would add up.
            self._next_frame = max(self._next_frame, self.time - self.frame_period) + self.frame_period
            self._listener(self.frame())
        if self.film_period and self.localizer is not None and self.time >= self._next_film:
            self._next_film = self.time + self.film_period
            estimate = self._localized(self.localizer)
            if self._listener is not None and estimate is self._told:
                self._listener(estimate)

    def _localized(self, localizer: PoseSource) -> PosesEstimated:
        """Where things are by what the cameras see; if that is news, those who watch are shown from which points."""
        estimate = localizer.now()
        if self._listener is not None and (self._told is None or estimate.differs_from(self._told, _NEWS)):
            self._told = estimate
            self._listener(localizer.cloud())
        return estimate

    def frame(self) -> Frame:
        """Where every body that can move is."""
        poses = scenery.mujoco_poses(self.model, self.data)
        told = np.append(self.data.ctrl[self._servo], self._closed)
        return Frame(poses, self.joints(), self.gripper_width(), told, self.gripper_joints())

    def show(self, frame: Frame) -> None:
        """Have everything be where a frame has it, for drawing it; nothing moves on from there as it did then."""
        self.data.qpos[self._arm] = frame.joints
        if frame.fingers is not None:
            self.data.qpos[self._finger_joints] = frame.fingers
        self.drawers.show(frame.poses)
        for item, pose in frame.poses.items():
            if item in self._places:
                self.put(item, pose)

    def settle(self, seconds: float) -> None:
        """Advances the time with the arm's command unchanged."""
        period = self._steps * self.model.opt.timestep
        for _ in range(max(1, round(seconds / period))):
            self.advance()

    def close(self) -> None:
        """Free the off-screen renderers, the model and its state; nothing can be done with the world afterwards.

        They are let go of by hand, because a hundred megabytes should not wait for the garbage collector to find the
        cycles of whoever used them.
        """
        self._listener = self.localizer = None
        self._scheduled.clear()
        if hasattr(self, "model"):
            self.cameras.drawing.close()
            del self.model, self.data, self.cameras, self.drawers

    def pose(self, item: str) -> FloatArray:
        """Where an item is, (7,), without error."""
        start = self._places[item]
        return np.array(self.data.qpos[start : start + 7])

    def poses(self) -> dict[str, FloatArray]:
        """Where all items are, (7,) each, without error."""
        return {item: self.pose(item) for item in self._places}

    def places(self) -> dict[str, placement.Place]:
        """Everything that items can be put on, where it is now."""
        return {**placement.places(self.spec), **self.drawers.floors()}

    def spec_now(self) -> SceneSpec:
        """The scene with its drawers as far open as they are now."""
        shares = {name: m / self.drawers.specs[name].stroke for name, m in self.drawers.openings().items()}
        return self.spec.with_drawers(shares)

    def _limits(self, file: Path) -> ArmLimits:
        ranges = np.array([self.model.joint(name).range for name in scene.JOINTS])
        home = np.asarray(self.spec.robot.home, dtype=float)
        outside = [name for name, q, (low, high) in zip(scene.JOINTS, home, ranges, strict=True) if not low < q < high]
        if outside:
            raise DomainError(f"{outside[0]} does not turn that far", file=file, key="robot.home")
        # Within half a turn of home: the arm never winds itself up, and every pose has one name.
        speed = self.spec.robot.speed
        return ArmLimits(
            lower=np.maximum(ranges[:, 0], home - np.pi),
            upper=np.minimum(ranges[:, 1], home + np.pi),
            velocity=speed * RATED_VELOCITY,
            acceleration=speed * RATED_ACCELERATION,
            jerk=speed * RATED_JERK,
            home=home,
        )

    def _reset(
        self,
        placed: dict[str, str],
        file: Path,
        barred: Mapping[str, Collection[str]] = MappingProxyType({}),
        held: str | None = None,
        stacked: Mapping[str, str] = MappingProxyType({}),
        regions: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        home = np.asarray(self.spec.robot.home)
        self._closed = 0.0
        for _ in range(20):
            mujoco.mj_resetData(self.model, self.data)
            self.data.qpos[self._arm] = home
            self.command(home, np.zeros(6))
            for name, drawer in self.drawers.specs.items():
                self.drawers.slide(name, drawer.open * drawer.stroke)
            shapes = {item: self.shapes[item] for item in self.items if item != held}
            poses = placement.draw(self.spec, shapes, placed, self._placement_rng, file, barred, stacked, regions)
            for item, pose in poses.items():
                self.put(item, pose)
            for number, box in enumerate(self.boxes):
                self.put(box, disturbances.aside(self.spec, number, float(self.shapes[box].half[2])))
            if held is not None:
                self.put(held, disturbances.aside(self.spec, len(self.boxes), float(self.shapes[held].half[2])))
            mujoco.mj_forward(self.model, self.data)
            if touched := self._touched_by_arm() - self._places.keys():
                raise DomainError(f"there the arm touches {min(touched)}", file=file, key="robot.home")
            if held is not None:
                self._hand_over(held, file)
            self.settle(0.6)
            if held is not None and self.gripped() != held:
                raise DomainError(f"the hand does not keep hold of {held} at home", file=file, key="robot.home")
            if all(self._stayed(item, pose) for item, pose in poses.items()):
                self.data.time = 0.0
                return
        raise DomainError("in 20 draws the items never came to rest upright: give them more room", file=file,
                          key="placement")  # fmt: skip

    def _hand_over(self, item: str, file: Path) -> None:
        """Have someone hold an item between the open fingers until they have closed, and then let go of it."""
        hand = self.data.site(scene.GRIP_SITE)
        pose = scene.in_hand(self.shapes[item], np.array(hand.xpos), np.array(hand.xmat).reshape(3, 3))
        if pose is None:
            raise DomainError(f"{item} is too wide for the hand to hold it upright", file=file, key="item")
        dof = self.model.joint(f"{item}/free").dofadr[0]
        self.put(item, pose)
        if touched := self.touched_by(item) & {*self._places, *placement.places(self.spec)}:
            raise DomainError(f"in the hand at home, {item} touches {min(touched)}", file=file, key="robot.home")
        self._closed = 1.0
        for _ in range(round(_HAND_OVER / CONTROL_PERIOD)):
            self.put(item, pose)
            self.data.qvel[dof : dof + 6] = 0.0
            self.advance()

    def _stayed(self, item: str, pose: FloatArray) -> bool:
        now = self.pose(item)
        return bool(np.linalg.norm(now[:3] - pose[:3]) < 0.02 and abs(float(now[3:] @ pose[3:])) > 0.99)

    def _touched_by_arm(self) -> set[str]:
        """What the arm or the hand touches, itself left out: bodies by the name of their root."""
        arm, roots = self.model.body("shoulder_link").rootid[0], self.model.body_rootid
        pairs = ({int(roots[self.model.geom_bodyid[geom]]) for geom in contact.geom}
                 for contact in self.data.contact[: self.data.ncon])  # fmt: skip
        return {self.model.body(body).name for pair in pairs if arm in pair for body in pair - {arm}}

    def put(self, item: str, pose: FloatArray) -> None:
        """Have an item be at a pose (7,) at once."""
        start = self._places[item]
        self.data.qpos[start : start + 7] = pose

    def touched_by(self, item: str) -> set[str]:
        """What touches an item, by the names of the outermost bodies."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        mine, roots = self.model.body(item).id, self.model.body_rootid
        pairs = ({int(roots[self.model.geom_bodyid[geom]]) for geom in contact.geom}
                 for contact in self.data.contact[: self.data.ncon])  # fmt: skip
        return {self.model.body(other).name for pair in pairs if mine in pair for other in pair - {mine}}

    def gripped(self) -> str | None:
        """The item around the grip point when the fingers are closed, so that nobody moves it."""
        if self._closed < 0.5 or not self.items:
            return None
        grip = self.data.site(scene.GRIP_SITE).xpos
        distance = {name: self.shapes[name].distance(self.pose(name), grip) for name in self.items}
        nearest_item = min(distance, key=distance.__getitem__)
        return nearest_item if distance[nearest_item] < 0.03 else None


def compiled(spec: SceneSpec, file: Path) -> mujoco.MjModel:
    """The scene's model.

    Raises:
        DomainError: MuJoCo refuses it.
    """
    try:
        return scene.build(spec).compile()
    except ValueError as error:
        raise DomainError(f"MuJoCo refuses this scene: {error}", file=file) from error
    finally:
        give_back_memory()  # what the compiler takes is as much again as all that the process had
