"""From a scene specification to MuJoCo models: one to simulate and draw, one without visuals to plan in.

Grasping is by contact and friction alone: there is no weld, no equality constraint between hand and item, and nothing
that moves an item but forces.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
import numpy.typing as npt

from executive.sim import assets, compound, meshes
from executive.sim.fixtures import Block, DrawerSpec
from executive.sim.part_spec import Material
from executive.sim.spec import TEXTURES, CameraSpec, ItemSpec, RegionSpec, SceneSpec, TableSpec
from executive.types import FloatArray

JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
FINGER_DRIVES = ("finger_1", "finger_2")
"""The Robotiq 85's two actuators, from 0 rad (open) to `FINGER_CLOSED`."""

FINGER_CLOSED = 0.8

FINGER_JOINTS = (
    "finger_joint",
    "left_inner_finger_joint",
    "left_inner_knuckle_joint",
    "right_outer_knuckle_joint",
    "right_inner_finger_joint",
    "right_inner_knuckle_joint",
)

PADS = ("left_fingerpad_collision", "right_fingerpad_collision")
PAD_HALF_THICKNESS = 0.001

GRIP_SITE = "grip_site"
"""Between the finger pads. Its z axis points out of the hand, its x axis from pad to pad."""

WIDEST_GRIP = 0.079
"""m between the pads that is still gripped; they open 85 mm."""

GRIP_DEPTH = 0.033
"""How far below an item's top the grip point may be, in m: the fingers' knuckles begin 34 mm above it."""

VISUAL, COLLISION, ITEM = 1, 0, 2
"""Geom groups: what is only drawn, what only collides, and items, which do both."""

SERVO = ((4000.0, 400.0), (4000.0, 400.0), (4000.0, 300.0), (1200.0, 60.0), (1200.0, 60.0), (1200.0, 60.0))
"""Stiffness (N m/rad) and damping (N m s/rad) of each joint's position servo."""

_TORQUE = (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)
"""The UR5e's maximum joint torques in N m, as robosuite's model gives them."""


@dataclass(frozen=True, slots=True, eq=False)
class ItemShape:
    """An item's bounding box in its own body frame: centre and half extents, each (3,) in m."""

    name: str
    centre: FloatArray
    half: FloatArray
    axis: int | None = None
    """The body axis (0, 1, 2 for x, y, z) that the shape is round about, None for a box and a ball."""
    is_ball: bool = False
    grip: FloatArray | None = None
    """The point (3,) in its body frame that the fingers close at; None for `centre`."""

    @property
    def gripped_at(self) -> FloatArray:
        """The point (3,) in its body frame that the fingers close at: at the height of its centre."""
        return self.centre if self.grip is None else self.grip

    def reach_from(self, point: FloatArray, direction: FloatArray) -> float:
        """How far in m the shape extends from a `point` (3,) along a unit vector (3,), both in its own frame."""
        return self.reach(direction) - float((point - self.centre) @ direction)

    def reach(self, direction: FloatArray) -> float:
        """How far in m the shape extends from its centre along the unit vector `direction` (3,) of its own frame."""
        if self.is_ball:
            return float(self.half[0])
        if self.axis is None:
            return float(np.abs(direction) @ self.half)
        along = abs(float(direction[self.axis]))
        radius = float(np.delete(self.half, self.axis).max())
        return along * float(self.half[self.axis]) + radius * math.sqrt(max(0.0, 1.0 - along * along))

    def distance(self, pose: FloatArray, point: FloatArray) -> float:
        """How far in m a `point` (3,) is from the box of an item at `pose` (7,), both in the world frame; 0 inside."""
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, pose[3:])
        local = (point - pose[:3]) @ rotation.reshape(3, 3) - self.centre
        return float(np.linalg.norm(np.maximum(np.abs(local) - self.half, 0.0)))


def build(spec: SceneSpec, *, visuals: bool = True) -> mujoco.MjSpec:
    """The scene as an MjSpec. Without `visuals` it is the model to plan in: the same joints, nothing to draw."""
    scene = mujoco.MjSpec()
    scene.modelname = "executive"
    scene.compiler.degree = False
    scene.option.timestep = spec.timestep
    # robosuite's own contact settings: an elliptic cone and a high ratio keep what is gripped from creeping.
    scene.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    scene.option.impratio = 20
    scene.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    scene.visual.global_.offwidth = max(camera.width for camera in spec.cameras)
    scene.visual.global_.offheight = max(camera.height for camera in spec.cameras)
    # Multisampling costs half of a picture's time in software GL (measured: 126 against 58 ms at 384x384).
    scene.visual.quality.offsamples = 0
    # No shadows are drawn (executive.sim.rendering); the map for them would take 64 MB of each renderer.
    scene.visual.quality.shadowsize = 0
    scene.visual.map.znear = 0.01
    scene.visual.headlight.ambient = [0.35, 0.35, 0.35]
    scene.visual.headlight.diffuse = [0.35, 0.35, 0.35]
    scene.visual.headlight.specular = [0.0, 0.0, 0.0]
    _surroundings(scene, visuals)
    _robot(scene, spec)
    for table in spec.tables:
        _table(scene, table, visuals)
    if visuals:
        for region in spec.regions:
            _region(scene, region)
    for container in spec.containers:
        fixed = scene.worldbody.add_body(name=container.name, pos=container.centre, quat=_about_z(container.yaw))
        _blocks(fixed, container.name, container.blocks(), container.rgba)
    for drawer in spec.drawers:
        _drawer(scene, drawer)
    for item in spec.items:
        _item(scene, item)
    for camera in spec.cameras:
        _camera(scene, camera)
    if not visuals:
        for geom in list(scene.geoms):
            if geom.contype == 0 and geom.conaffinity == 0:
                scene.delete(geom)
            else:
                geom.material = ""
        for kind in (scene.materials, scene.textures):
            for thing in list(kind):
                scene.delete(thing)
        meshes.drop_unused(scene)
    else:
        meshes.lighten(scene)
    return scene


def _surroundings(scene: mujoco.MjSpec, visuals: bool) -> None:
    world = scene.worldbody
    floor = world.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[3, 3, 0.1], rgba=[0.72, 0.74, 0.77, 1])
    floor.group = ITEM
    if visuals:
        scene.add_texture(
            name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
            rgb1=[0.93, 0.95, 0.98], rgb2=[0.60, 0.66, 0.74], width=128, height=768,
        )  # fmt: skip
        world.add_light(
            name="ceiling", type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, dir=[-0.25, 0.1, -1.0], pos=[0.8, 0.0, 3.0],
            diffuse=[0.55, 0.55, 0.55], ambient=[0.05, 0.05, 0.05], specular=[0.1, 0.1, 0.1], castshadow=False,
        )  # fmt: skip


def _robot(scene: mujoco.MjSpec, spec: SceneSpec) -> None:
    arm = assets.load("robots/ur5e/robot.xml")
    for actuator in list(arm.actuators):
        arm.delete(actuator)
    for camera in list(arm.cameras):
        arm.delete(camera)
    gripper = assets.load("grippers/robotiq_gripper_85.xml")
    _linkage(gripper)
    arm.attach(gripper, prefix="", suffix="", frame=arm.body("right_hand").add_frame())
    x, y, z = spec.robot.position
    half = 0.5 * spec.robot.yaw
    mount = scene.worldbody.add_frame(pos=[x, y, z], quat=[math.cos(half), 0.0, 0.0, math.sin(half)])
    scene.attach(arm, prefix="", suffix="", frame=mount)
    # A plain column rather than robosuite's pedestal, which is wider than the space between robot and tables.
    if z > 0.01:
        scene.worldbody.add_geom(
            name="pedestal", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.09, 0.5 * z - 0.001, 0],
            pos=[x, y, 0.5 * z - 0.001], rgba=[0.25, 0.26, 0.28, 1], group=ITEM,
        )  # fmt: skip
    # MuJoCo leaves out contacts between parent and child, but not where the parent is fixed to the world.
    scene.add_exclude(bodyname1="fixed_base_link", bodyname2="shoulder_link")
    for site in scene.sites:
        site.rgba = [0, 0, 0, 0]
    moving = False
    for body in scene.bodies:
        # The real controller compensates the arm's own weight; what it carries it has to feel.
        moving = moving or body.name == "shoulder_link"
        if moving and body.name != "world":
            body.gravcomp = 1.0
    for joint, (stiffness, damping), torque in zip(JOINTS, SERVO, _TORQUE, strict=True):
        scene.joint(joint).armature = 0.1
        _position_servo(scene, joint, stiffness, damping, torque)
    for drive in FINGER_DRIVES:
        scene.actuator(drive).forcerange = [-_GRIP_TORQUE, _GRIP_TORQUE]
        scene.actuator(drive).forcelimited = True
    for geom in scene.geoms:
        if geom.name.endswith(("fingerpad_collision", "fingertip_collision")):
            geom.friction = [1.2, 0.05, 0.001]
            geom.condim = 4
            geom.solimp = [0.95, 0.99, 0.001, 0.5, 2]


_GRIP_TORQUE = 3.0
"""Limit of each finger's drive in N m; with the 0.1 m finger it is of the order of the real gripper's 20 to 235 N."""


def _linkage(gripper: mujoco.MjSpec) -> None:
    """Make the fingers move as the Robotiq 85's do: one motor, and bars that keep the pads parallel.

    robosuite couples the joints by springs, so that the pads tilt with what they press on. The constraints here are
    between the hand's own joints; what is gripped is held by friction alone.
    """
    for tendon in list(gripper.tendons):
        gripper.delete(tendon)
    for joint, sign in (
        ("right_outer_knuckle_joint", 1.0),
        ("left_inner_knuckle_joint", 1.0),
        ("right_inner_knuckle_joint", 1.0),
        ("left_inner_finger_joint", -1.0),
        ("right_inner_finger_joint", -1.0),
    ):
        gripper.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, name1=joint, name2="finger_joint",
            data=[0.0, sign, 0, 0, 0, 0, 0, 0, 0, 0, 0], solref=[0.004, 1.0], solimp=[0.98, 0.999, 0.001, 0.5, 2],
        )  # fmt: skip
    for joint in gripper.joints:
        joint.armature = 0.002
        joint.damping[0] = 0.05
    names = [body.name for body in gripper.bodies if body.name not in ("world", "eef")]
    for index, first in enumerate(names):
        for second in names[index + 1 :]:
            gripper.add_exclude(bodyname1=first, bodyname2=second)


def _position_servo(scene: mujoco.MjSpec, joint: str, stiffness: float, damping: float, torque: float) -> None:
    actuator = scene.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.gainprm[0] = stiffness
    actuator.biasprm[1] = -stiffness
    actuator.biasprm[2] = -damping
    actuator.forcelimited = True
    actuator.forcerange = [-torque, torque]


def _table(scene: mujoco.MjSpec, table: TableSpec, visuals: bool) -> None:
    half = 0.5 * np.asarray(table.size)
    x, y, top = table.centre
    body = scene.worldbody.add_body(
        name=table.name, pos=[x, y, top - half[2]], quat=[math.cos(table.yaw / 2), 0, 0, math.sin(table.yaw / 2)]
    )
    plate = body.add_geom(
        name=f"{table.name}/top",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=half,
        rgba=table.rgba,
        friction=[1.0, 0.005, 0.0001],
    )
    plate.group = ITEM
    if table.rim > 0.0:
        _rim(body, table, half)
    if not visuals:
        return
    if table.texture is not None:
        scene.add_texture(
            name=f"{table.name}/texture",
            type=mujoco.mjtTexture.mjTEXTURE_2D,
            file=assets.texture(TEXTURES[table.texture]),
        )
        material = scene.add_material(name=f"{table.name}/material", texuniform=True, texrepeat=[2, 2], specular=0.1)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = f"{table.name}/texture"
        plate.material = f"{table.name}/material"
    leg = 0.5 * (top - table.size[2])
    if leg < 0.005:  # a block that stands on the floor
        return
    for side_x in (-1, 1):
        for side_y in (-1, 1):
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.015, leg, 0], group=VISUAL, contype=0, conaffinity=0,
                pos=[side_x * (half[0] - 0.03), side_y * (half[1] - 0.03), -half[2] - leg], rgba=[0.35, 0.36, 0.38, 1],
            )  # fmt: skip


_RIM = 0.008
"""m that a table's rim is thick; it stands outside of the top."""


def _rim(body: mujoco.MjsBody, table: TableSpec, half: FloatArray) -> None:
    height = 0.5 * (table.size[2] + table.rim)
    for axis in (0, 1):
        for side in (-1, 1):
            size, position = np.array([*half[:2], height]), np.array([0.0, 0.0, height - half[2]])
            size[axis], size[1 - axis] = 0.5 * _RIM, half[1 - axis] + (_RIM if axis == 0 else 0.0)
            position[axis] = side * (half[axis] + 0.5 * _RIM)
            body.add_geom(
                name=f"{table.name}/rim-{2 * axis + (side + 1) // 2}", type=mujoco.mjtGeom.mjGEOM_BOX, size=size,
                pos=position, rgba=table.rgba, group=ITEM,
            )  # fmt: skip


_PAINT = 0.0005
"""m that a painted region is thick: what is drawn in the very plane of a table's top flickers."""


def _region(scene: mujoco.MjSpec, region: RegionSpec) -> None:
    if region.rgba is None:
        return
    table = scene.body(region.table)
    top = scene.geom(f"{region.table}/top").size[2]
    table.add_geom(
        name=f"{region.name}/paint", type=mujoco.mjtGeom.mjGEOM_BOX, group=VISUAL, contype=0, conaffinity=0,
        size=[0.5 * region.size[0], 0.5 * region.size[1], _PAINT], pos=[*region.centre, top], rgba=region.rgba,
    )  # fmt: skip


def _about_z(yaw: float) -> list[float]:
    return [math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)]


_CASE = 0.82
"""How bright a drawer's case is, as a share of the drawer itself."""

_SHADES = {"floor": 1.18, "side-1": 0.92, "side-2": 0.92, "back": 0.88}
"""Likewise of what is in it: a viewer that draws without light shows walls and floor all the same."""

_STOP = ([0.006, 1.0], [0.95, 0.99, 0.001, 0.5, 2.0])
"""How hard the ends of a drawer's way are (MuJoCo's solref and solimp)."""


_STICTION = [0.99, 0.9999, 0.001, 0.5, 2.0]
"""How hard a drawer's friction is (MuJoCo's solimp): by default, a drawer that sticks creeps along."""


def _drawer(scene: mujoco.MjSpec, drawer: DrawerSpec) -> None:
    """A drawer on a joint that slides, in a case that touches everything but the drawer."""
    case, turn = f"{drawer.name}/case", _about_z(drawer.yaw)
    fixed = scene.worldbody.add_body(name=case, pos=drawer.front, quat=turn)
    _blocks(fixed, case, drawer.case(), (*(_CASE * c for c in drawer.rgba[:3]), drawer.rgba[3]))
    body = scene.worldbody.add_body(name=drawer.name, pos=drawer.front, quat=turn)
    body.add_joint(
        name=slide_of(drawer.name), type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[-1.0, 0.0, 0.0], limited=True,
        range=[0.0, drawer.stroke], frictionloss=drawer.friction, damping=[drawer.damping, 0.0, 0.0],
        solref_limit=_STOP[0], solimp_limit=_STOP[1], solimp_friction=_STICTION,
    )  # fmt: skip
    blocks = drawer.blocks()
    _blocks(body, drawer.name, blocks, drawer.rgba)
    for name, share in _SHADES.items():
        scene.geom(f"{drawer.name}/{name}").rgba = [*(min(1.0, share * c) for c in drawer.rgba[:3]), drawer.rgba[3]]
    volume = sum(8.0 * math.prod(block.half) for block in blocks)
    for geom in body.geoms:
        geom.density = drawer.mass / volume
    bar = scene.geom(f"{drawer.name}/handle")
    bar.rgba, bar.friction, bar.condim = [0.55, 0.57, 0.6, 1.0], [0.8, 0.02, 0.001], 4
    scene.add_exclude(bodyname1=case, bodyname2=drawer.name)


def slide_of(drawer: str) -> str:
    """The name of the joint that a drawer slides on."""
    return f"{drawer}/slide"


def _blocks(body: mujoco.MjsBody, name: str, blocks: Iterable[Block], rgba: Sequence[float]) -> None:
    for block in blocks:
        body.add_geom(
            name=f"{name}/{block.name}", type=mujoco.mjtGeom.mjGEOM_BOX, pos=block.centre, size=block.half, rgba=rgba,
            friction=[1.0, 0.005, 0.0001], group=ITEM,
        )  # fmt: skip


_PRIMITIVES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
}

_CHROME: Final = "chrome"

_SHINE = {"rubber": (0.1, 0.05), "wood": (0.15, 0.1), "glass": (1.0, 0.9), "metal": (1.0, 0.6), _CHROME: (1.0, 0.6)}
"""Specularity and shininess of materials, from 0 to 1, as MuJoCo draws them."""

_TEXELS = 64
"""The side of each of the six pictures of what chrome reflects."""


_GLOW = 0.25
"""The emission that makes up for what its picture takes from the colour of chrome."""


def _reflected() -> npt.NDArray[np.uint8]:
    """What chrome reflects, around it, (6 * _TEXELS, _TEXELS, 3) from +x, -x, +y, -y, +z and -z: a bright sky with
    lamps in it, a dark horizon, and a floor. MuJoCo itself reflects nothing in what is not flat."""
    across, down = np.meshgrid(*[(np.arange(_TEXELS) + 0.5) / _TEXELS * 2.0 - 1.0] * 2)
    one = np.ones_like(across)
    sides = [(one, -down, -across), (-one, -down, across), (across, one, down), (across, -one, -down),
             (across, -down, one), (-across, -down, -one)]  # fmt: skip
    ways = np.stack([np.stack(side, axis=-1) for side in sides])
    ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
    up = ways[..., 2]
    light = np.where(up > 0.0, 0.35 + 0.6 * np.clip(up, 0.0, 1.0) ** 0.6, 0.95 + 0.5 * np.clip(up, -1.0, 0.0))
    for lamp in ((0.5, 0.3, 0.8), (-0.6, 0.4, 0.7), (0.1, -0.7, 0.7)):
        light += 0.5 * np.exp(40.0 * (ways @ (np.array(lamp) / np.linalg.norm(lamp)) - 1.0))
    grey = np.clip(255.0 * light, 0.0, 255.0).astype(np.uint8)
    return np.repeat(grey.reshape(6 * _TEXELS, _TEXELS, 1), 3, axis=2)


def _chrome(scene: mujoco.MjSpec, name: str) -> mujoco.MjsMaterial:
    """A material that shows what `_reflected` says."""
    if not any(texture.name == _CHROME for texture in scene.textures):
        texture = scene.add_texture(
            name=_CHROME, type=mujoco.mjtTexture.mjTEXTURE_CUBE, width=_TEXELS, height=6 * _TEXELS, nchannel=3
        )
        texture.data = _reflected().tobytes()
    material = scene.add_material(name=name, emission=_GLOW)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = _CHROME
    return material


def _made_of(scene: mujoco.MjSpec, name: str, material: Material, geom: mujoco.MjsGeom) -> None:
    _add_material(scene, name, material, geom)
    geom.material = _material_name(name, material)


def _add_material(scene: mujoco.MjSpec, name: str, material: Material, geom: mujoco.MjsGeom) -> None:
    called = _material_name(name, material)
    made = _chrome(scene, called) if material == _CHROME else scene.add_material(name=called)
    made.specular, made.shininess = _SHINE[material]
    made.rgba = geom.rgba


def _material_name(name: str, material: Material) -> str:
    return f"{name}/{_CHROME}" if material == _CHROME else f"{name}/material"


def paint(model: mujoco.MjModel, item: ItemSpec) -> None:
    """Give a described item of a primitive shape the colour and the material that `item` has. The model's item has the
    same name and shape, and a material if this one has any."""
    assert item.rgba is not None
    geom = model.geom(f"{item.name}/body")
    geom.rgba = item.rgba
    if item.material is not None:
        material = model.material(_material_name(item.name, item.material))
        geom.matid = material.id
        material.rgba = item.rgba
        material.specular, material.shininess = _SHINE[item.material]


def _item(scene: mujoco.MjSpec, item: ItemSpec) -> None:
    body = scene.worldbody.add_body(name=item.name)
    body.add_freejoint(name=f"{item.name}/free")
    friction = [item.friction, 0.02, 0.003]  # sliding; torsional and rolling, both in m: round things come to rest
    if item.shape is not None and item.size is not None:
        x, y, z = (0.5 * extent for extent in item.size)
        size = {"box": [x, y, z], "cylinder": [x, z, 0], "sphere": [x, 0, 0]}[item.shape]
        geom = body.add_geom(
            name=f"{item.name}/body", type=_PRIMITIVES[item.shape], size=size,
            rgba=item.rgba or (0.7, 0.7, 0.7, 1), mass=item.mass, friction=friction, condim=6, group=ITEM,
        )  # fmt: skip
        if item.material is not None:
            _made_of(scene, item.name, item.material, geom)
            if item.attributes:  # which `paint` may change
                other: Material = "rubber" if item.material == _CHROME else _CHROME
                _add_material(scene, item.name, other, geom)
        return
    if item.parts:
        for geom, part in zip(
            compound.add_parts(scene, body, item.name, item.parts, item.mass), item.parts, strict=True
        ):
            geom.friction, geom.condim, geom.group = friction, 6, ITEM
            if part.material is not None:
                _made_of(scene, geom.name, part.material, geom)
        return
    source = assets.load(f"objects/{item.asset}.xml")
    inner = source.body("object")
    for site in list(source.sites):
        source.delete(site)
    factor = np.broadcast_to(np.asarray(item.scale, dtype=float), 3)
    for mesh in source.meshes:
        mesh.scale = np.asarray(mesh.scale) * factor
    geoms = list(inner.geoms)
    for geom in geoms[:-1]:
        source.delete(geom)  # the bottle's file draws its mesh twice
    geom = geoms[-1]
    geom.name = "body"
    geom.group = ITEM
    geom.mass = item.mass
    geom.friction = friction
    geom.condim = 6
    # robosuite's 1 ms contacts are stiffer than a 2 ms step resolves.
    geom.solref = [0.005, 1.0]
    geom.solimp = [0.95, 0.99, 0.001, 0.5, 2]
    if item.rgba is not None:
        geom.rgba = item.rgba
    for material in source.materials:
        material.reflectance = 0.0
    frame = body.add_frame()
    frame.attach_body(inner, f"{item.name}/", "")


def _camera(scene: mujoco.MjSpec, camera: CameraSpec) -> None:
    position, target = np.asarray(camera.position), np.asarray(camera.target)
    backward = position - target
    backward /= np.linalg.norm(backward)
    right = np.cross([0.0, 0.0, 1.0], backward)
    if np.linalg.norm(right) < 1e-6:  # straight down: let +y be up in the picture
        right = np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(backward, right), backward], axis=1)
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, rotation.flatten())
    scene.worldbody.add_camera(
        name=camera.name,
        pos=position,
        quat=quaternion,
        fovy=camera.fovy_degrees,
        resolution=[camera.width, camera.height],
    )


def in_hand(shape: ItemShape, grip: FloatArray, hand: FloatArray) -> FloatArray | None:
    """The pose (7,) of an item that hangs upright between the fingers, gripped near its top; None where it is too wide.

    Args:
        grip, hand: where the grip point is (3,), and the axes of its site as columns (3, 3), in the world.
    """
    closing, approach = hand[:, 0], hand[:, 2]
    widths = shape.half[:2] if shape.axis is None else [shape.reach(axis) for axis in np.eye(3)[:2]]
    across = int(np.argmin(widths))
    if 2 * float(widths[across]) > WIDEST_GRIP:
        return None
    up = -approach
    rotation = np.empty((3, 3))
    rotation[:, across], rotation[:, 2] = closing, up
    # The third axis makes it a rotation: x cross y is z.
    rotation[:, 1 - across] = np.cross(up, closing) if across == 0 else np.cross(closing, up)
    centre = grip + max(0.0, float(shape.half[2]) - GRIP_DEPTH) * approach
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, rotation.flatten())
    return np.concatenate([centre - rotation @ shape.gripped_at, quaternion])


_ROUND = {"can": 2, "bottle": 2, "lemon": 0}
"""robosuite's assets that are round, and about which axis of their body."""


def item_shapes(model: mujoco.MjModel, spec: SceneSpec) -> dict[str, ItemShape]:
    """Each item's bounding box, from the compiled geometry."""
    shapes = {}
    for item in spec.items:
        round_points, other_points = [np.zeros((0, 3))], [np.zeros((0, 3))]
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        root = model.body(item.name).id
        for geom in range(model.ngeom):
            if model.body_rootid[model.geom_bodyid[geom]] != root:
                continue
            points = in_root_frame(model, geom, _geom_points(model, geom))
            (round_points if item.is_round(model.geom(geom).name) else other_points).append(points)
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        axis = _ROUND.get(item.asset or "", 2 if item.shape == "cylinder" else None)
        if item.parts and _is_within(np.concatenate(other_points), np.concatenate(round_points)):
            axis = 2
        centre = 0.5 * (low + high)
        grip = None if item.grip is None else np.array([*item.grip, centre[2]])
        shapes[item.name] = ItemShape(item.name, centre, 0.5 * (high - low), axis, item.shape == "sphere", grip)
    return shapes


def _is_within(points: FloatArray, turned: FloatArray) -> bool:
    """Whether points (N, 3) are within the cylinder about the z axis that is drawn around others (M, 3)."""
    if not len(turned):
        return False
    radius, (low, high) = np.hypot(*turned[:, :2].T).max(), (turned[:, 2].min(), turned[:, 2].max())
    return bool((np.hypot(*points[:, :2].T) <= radius).all() and ((points[:, 2] >= low) & (points[:, 2] <= high)).all())


def _geom_points(model: mujoco.MjModel, geom: int) -> FloatArray:
    """Points of a geom whose hull is its shape, in the geom's frame."""
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        return np.asarray(model.mesh_vert[start : start + model.mesh_vertnum[mesh]], dtype=float)
    centre, half = model.geom_aabb[geom][:3], model.geom_aabb[geom][3:]
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    return np.asarray(centre + corners * half)


def in_root_frame(model: mujoco.MjModel, geom: int, points: FloatArray) -> FloatArray:
    """Points (N, 3) of a geom's frame in that of its outermost body."""
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    points = points @ rotation.reshape(3, 3).T + model.geom_pos[geom]
    body = model.geom_bodyid[geom]
    while model.body_parentid[body] != 0:
        mujoco.mju_quat2Mat(rotation, model.body_quat[body])
        points = points @ rotation.reshape(3, 3).T + model.body_pos[body]
        body = model.body_parentid[body]
    return points
