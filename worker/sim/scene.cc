// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/scene.h"

#include <fmt/format.h>

#include <cstdlib>
#include <cstring>
#include <mutex>
#include <set>

#include "services/core/check.h"
#include "services/core/log.h"
#include "services/spec/object_names.h"
#include "services/spec/robot_names.h"
#include "worker/sim/model.h"
#include "worker/sim/robot_file.h"
#include "worker/synthesis/scene_object.h"

namespace etude::sim {
namespace {

using Eigen::Vector3d;

constexpr double kSlabHalf = 2.0;        ///< m: beyond the arm's reach
constexpr double kTableThickness = 0.1;  ///< m
constexpr double kStopMargin = 0.03;     ///< rad before a joint's stop where the controller holds against it

void OnError(const char* message) {
  Log().critical("MuJoCo stopped: {}", message);
  std::abort();
}

void OnWarning(const char* message) { Log().debug("MuJoCo warned: {}", message); }

/// mjVFS is 4 MB: on the heap, freed with its files.
struct Files {
  Files() : vfs(std::make_unique<mjVFS>()) { mj_defaultVFS(vfs.get()); }
  ~Files() { mj_deleteVFS(vfs.get()); }
  Status Add(const std::string& name, const void* bytes, std::size_t size) {
    constexpr int kFull = 1;
    const int status = mj_makeEmptyFileVFS(vfs.get(), name.c_str(), static_cast<int>(size));
    if (status == kFull)
      return Fail(Code::kExhausted, fmt::format("MuJoCo {} takes {} files of meshes and pictures for one scene, and "
                                                "this one has more: give it fewer objects",
                                                mj_versionString(), mjMAXVFS - 1));
    ETUDE_CHECK(status == 0, "file {} of {} bytes, status {}", name, size, status);
    const int index = mj_findFileVFS(vfs.get(), name.c_str());
    ETUDE_CHECK(index >= 0, "file {}", name);
    std::memcpy(vfs->filedata[index], bytes, size);
    return {};
  }
  std::unique_ptr<mjVFS> vfs;
};

int Id(const mjModel* model, mjtObj type, const std::string& name) {
  const int id = mj_name2id(model, type, name.c_str());
  ETUDE_CHECK(id >= 0, "the scene has no {}", name);
  return id;
}

void FillAddresses(Scene::Model& model, const assets::SceneDescription& description) {
  const mjModel* mj = model.mj.get();
  model.robot = description.robot;
  for (const std::string& name : model.robot.joints) {
    const int joint = Id(mj, mjOBJ_JOINT, name);
    model.arm_q.push_back(mj->jnt_qposadr[joint]);
    model.arm_v.push_back(mj->jnt_dofadr[joint]);
    model.arm_u.push_back(Id(mj, mjOBJ_ACTUATOR, name));
    model.has_friction = model.has_friction || mj->dof_frictionloss[mj->jnt_dofadr[joint]] > 0;
    model.soft_low.push_back(mj->jnt_range[2 * joint] + kStopMargin);
    model.soft_high.push_back(mj->jnt_range[2 * joint + 1] - kStopMargin);
  }
  for (const std::string& name : model.robot.gripper_joints)
    model.gripper_q.push_back(mj->jnt_qposadr[Id(mj, mjOBJ_JOINT, name)]);
  model.gripper_u = Id(mj, mjOBJ_ACTUATOR, model.robot.gripper_joints.at(0));
  for (const auto& coupled : model.robot.coupled_joints)
    model.coupled_q.push_back({mj->jnt_qposadr[Id(mj, mjOBJ_JOINT, coupled.joint)], coupled.factor, coupled.offset});
  model.tool_site = Id(mj, mjOBJ_SITE, model.robot.tool_site);
  for (const auto& group : model.robot.finger_groups)
    for (const std::string& name : group) Id(mj, mjOBJ_BODY, name);
  for (int body = 0; body < mj->nbody; ++body) {
    // what MuJoCo makes of a <composite> may have none
    if (const char* name = mj_id2name(mj, mjOBJ_BODY, body)) model.bodies.emplace(name, body);
  }
  model.tree = ArmTree(*mj, model.tool_site, model.arm_q);
  for (const std::string& body : model.robot.bodies) model.arm_bodies.push_back(model.tree.IndexOf(model.BodyId(body)));
  for (const auto& object : description.objects) {
    const int joint = Id(mj, mjOBJ_JOINT, object.name);
    model.objects[object.name] = {Id(mj, mjOBJ_BODY, object.name), mj->jnt_qposadr[joint], mj->jnt_dofadr[joint]};
  }
}

Pose PoseOf(const mjtNum* pos, const mjtNum* quat) {
  return {Vector3d(pos[0], pos[1], pos[2]), Eigen::Quaterniond(quat[0], quat[1], quat[2], quat[3])};
}

/// Corners of a mesh's convex hull, in the mesh's (and so the geom's) frame.
std::vector<Vector3d> HullVertices(const mjModel* mj, int mesh) {
  ETUDE_CHECK(mj->mesh_graphadr[mesh] >= 0, "mesh {} has no hull", mesh);
  const int* graph = mj->mesh_graph + mj->mesh_graphadr[mesh];
  const int count = graph[0];
  const int* ids = graph + 2 + count;  // numvert, numface, vert_edgeadr[numvert], vert_globalid[numvert]
  const float* vertices = mj->mesh_vert + 3 * mj->mesh_vertadr[mesh];
  std::vector<Vector3d> hull;
  for (int i = 0; i < count; ++i)
    hull.push_back(Eigen::Map<const Eigen::Vector3f>(vertices + 3 * ids[i]).cast<double>());
  return hull;
}

Geometry MakeGeometry(const mjModel* mj, int geom) {
  Geometry piece;
  piece.body = mj_id2name(mj, mjOBJ_BODY, mj->geom_bodyid[geom]);
  const char* name = mj_id2name(mj, mjOBJ_GEOM, geom);
  piece.name = name ? name : fmt::format("{}/{}", piece.body, geom - mj->body_geomadr[mj->geom_bodyid[geom]]);
  piece.X_BG = PoseOf(mj->geom_pos + 3 * geom, mj->geom_quat + 4 * geom);
  const mjtNum* size = mj->geom_size + 3 * geom;
  piece.size = Vector3d(size[0], size[1], size[2]);
  switch (mj->geom_type[geom]) {
    case mjGEOM_PLANE:  // the half space below, as a slab as large as anything can reach
      piece.shape = Geometry::Shape::kBox;
      piece.size = Vector3d(kSlabHalf, kSlabHalf, kTableThickness / 2);
      piece.X_BG.p -= piece.X_BG.q * Vector3d(0, 0, kTableThickness / 2);
      break;
    case mjGEOM_BOX:
      piece.shape = Geometry::Shape::kBox;
      break;
    case mjGEOM_SPHERE:
      piece.shape = Geometry::Shape::kSphere;
      break;
    case mjGEOM_CAPSULE:
      piece.shape = Geometry::Shape::kCapsule;
      break;
    case mjGEOM_CYLINDER:
      piece.shape = Geometry::Shape::kCylinder;
      break;
    case mjGEOM_MESH:
      piece.shape = Geometry::Shape::kConvex;
      piece.vertices = HullVertices(mj, mj->geom_dataid[geom]);
      break;
    default:
      ETUDE_CHECK(false, "geom {} has type {}", piece.name, mj->geom_type[geom]);
  }
  return piece;
}

ArmInfo MakeArm(const Scene::Model& model) {
  const mjModel* mj = model.mj.get();
  const auto n = static_cast<Eigen::Index>(model.arm_q.size());
  ArmInfo arm;
  arm.joints = model.robot.joints;
  arm.q_home = Eigen::VectorXd::Map(model.robot.q_home.data(), n);
  arm.q_min.resize(n);
  arm.q_max.resize(n);
  arm.torque_limit.resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const int joint = Id(mj, mjOBJ_JOINT, arm.joints[i]);
    arm.q_min[i] = mj->jnt_range[2 * joint];
    arm.q_max[i] = mj->jnt_range[2 * joint + 1];
    arm.torque_limit[i] = mj->actuator_ctrlrange[2 * model.arm_u[i] + 1];
  }
  arm.gripper_joints = model.robot.gripper_joints;
  arm.bodies = model.robot.bodies;
  arm.joint_speed = Eigen::VectorXd::Map(model.robot.joint_speed.data(), n);
  arm.planned_speed = Eigen::VectorXd::Map(model.robot.planned_speed.data(), n);
  arm.finger_groups = model.robot.finger_groups;
  arm.approach_pitch = model.robot.approach_pitch;
  arm.turned_pitch = model.robot.turned_pitch;
  arm.gripper_open = model.robot.gripper_open;
  arm.gripper_closed = model.robot.gripper_closed;
  arm.tool_site = model.robot.tool_site;
  return arm;
}

}  // namespace

std::mutex& XmlMutex() {
  static std::mutex mutex;
  return mutex;
}

Result<ModelPtr> CompileXml(const std::string& mjcf, const std::vector<assets::AssetFile>& assets) {
  const std::lock_guard lock(XmlMutex());
  Files files;
  for (const auto& file : assets) ETUDE_RETURN_IF_ERROR(files.Add(file.name, file.bytes.data(), file.bytes.size()));
  ETUDE_RETURN_IF_ERROR(files.Add("scene.xml", mjcf.data(), mjcf.size()));
  char message[1000] = "";
  ModelPtr model;
  try {  // it has types of its own to throw
    model.reset(mj_loadXML("scene.xml", files.vfs.get(), message, sizeof message));
  } catch (...) {
    return Fail(Code::kInternal,
                fmt::format("MuJoCo {} failed on the composed scene without a word", mj_versionString()));
  }
  if (!model)
    return Fail(Code::kInternal, fmt::format("MuJoCo {} refused the composed scene: {}", mj_versionString(), message));
  if (message[0]) Log().warn("MuJoCo on the composed scene: {}", message);
  return model;
}

void InstallHandlers() {
  static std::once_flag once;
  std::call_once(once, [] {
    mju_user_error = OnError;
    mju_user_warning = OnWarning;  // without it MuJoCo writes MUJOCO_LOG.TXT where it stands
  });
}

int Scene::Model::BodyId(const std::string& name) const {
  const auto found = bodies.find(name);
  ETUDE_CHECK(found != bodies.end(), "the scene has no body '{}'", name);
  return found->second;
}

DataPtr Scene::Model::NewData() const {
  DataPtr data(mj_makeData(mj.get()));
  ETUDE_CHECK(data != nullptr, "no memory for mjData");
  return data;
}

void Scene::Model::SetHome(mjtNum* qpos) const {
  SetArm(qpos, Eigen::VectorXd::Map(robot.q_home.data(), static_cast<Eigen::Index>(robot.q_home.size())));
  SetGripper(qpos, 0);
}

void Scene::Model::SetArm(mjtNum* qpos, const Eigen::VectorXd& q) const {
  ETUDE_CHECK(q.size() == static_cast<Eigen::Index>(arm_q.size()), "{} joints given, the arm has {}", q.size(),
              arm_q.size());
  for (std::size_t i = 0; i < arm_q.size(); ++i) qpos[arm_q[i]] = q[static_cast<Eigen::Index>(i)];
}

void Scene::Model::SetGripper(mjtNum* qpos, double gripper) const {
  const double driven = robot.gripper_open + gripper * (robot.gripper_closed - robot.gripper_open);
  for (const int address : gripper_q) qpos[address] = driven;
  for (const auto& [address, factor, offset] : coupled_q) qpos[address] = offset + factor * driven;
}

Pose Scene::Model::ToolPose(const mjData* data) const {
  using Rows = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  return {Vector3d::Map(data->site_xpos + 3 * tool_site),
          Eigen::Quaterniond(Eigen::Matrix3d(Rows::Map(data->site_xmat + 9 * tool_site))).normalized()};
}

Pose Scene::Model::BodyPose(const mjData* data, int body) const {
  return PoseOf(data->xpos + 3 * body, data->xquat + 4 * body);
}

void Scene::Model::ToolJacobian(const mjData* data, std::vector<double>& scratch, Eigen::MatrixXd& J) const {
  const int nv = mj->nv;
  scratch.resize(6 * static_cast<std::size_t>(nv));
  mj_jacSite(mj.get(), data, scratch.data(), scratch.data() + 3 * nv, tool_site);
  J.resize(6, static_cast<Eigen::Index>(arm_v.size()));
  for (int row = 0; row < 6; ++row)
    for (std::size_t i = 0; i < arm_v.size(); ++i) J(row, static_cast<Eigen::Index>(i)) = scratch[row * nv + arm_v[i]];
}

Scene::Scene() : model_(std::make_unique<Model>()) {}
Scene::~Scene() = default;
int Scene::body_count() const { return model_->mj->nbody; }

namespace {

Result<assets::RobotModel> MakeRobot(const SceneSpec& spec) {
  std::set<std::string> taken{"world", "table", "sun"};
  for (const std::string& object : spec.objects) taken.insert(SceneName(object));
  ETUDE_ASSIGN_OR_RETURN(const Path yaml, FindRobot(spec.robot));
  ETUDE_ASSIGN_OR_RETURN(LoadedRobot loaded, LoadRobot(yaml, taken));
  return std::move(loaded.model);
}

}  // namespace

Result<std::shared_ptr<const Scene>> Scene::Build(const SceneSpec& spec) {
  InstallHandlers();
  ETUDE_ASSIGN_OR_RETURN(assets::RobotModel robot, MakeRobot(spec));
  ETUDE_ASSIGN_OR_RETURN(assets::SceneDescription description,
                         assets::DescribeScene(spec, std::move(robot), synthesis::MakeSceneObject));
  std::shared_ptr<Scene> scene(new Scene);
  ETUDE_ASSIGN_OR_RETURN(scene->model_->mj, CompileXml(description.mjcf, description.files));
  FillAddresses(*scene->model_, description);
  scene->arm_ = MakeArm(*scene->model_);
  for (const auto& object : description.objects)
    scene->objects_.push_back({object.name, object.half_extent, object.rest_height, object.mass});
  const mjModel* mj = scene->model_->mj.get();
  for (int geom = 0; geom < mj->ngeom; ++geom)
    if (Collides(mj, geom)) scene->geometry_.push_back(MakeGeometry(mj, geom));
  scene->camera_ = description.camera;
  scene->control_delay_ = spec.world.control_delay;
  scene->mjcf_ = std::move(description.mjcf);
  scene->sha256_ = std::move(description.sha256);
  return std::shared_ptr<const Scene>(std::move(scene));
}

}  // namespace etude::sim
