// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/robot_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <mujoco/mujoco.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "services/episode/pose.h"
#include "worker/sim/model.h"
#include "worker/sim/robot_xml.h"

namespace etude::sim {
namespace {

using Eigen::Vector3d;
using tinyxml2::XMLElement;

constexpr double kSpeedIfUnknown = 2.0;  ///< rad/s
constexpr const char* kToolSite = "etude_tool";

/// A file that is gone when this is.
struct TemporaryFile {
  TemporaryFile() : path((std::filesystem::temp_directory_path() / "etude-robot-XXXXXX").string()) {
    const int fd = ::mkstemp(path.data());
    if (fd >= 0) ::close(fd);
  }
  ~TemporaryFile() {
    std::error_code ignored;
    std::filesystem::remove(path, ignored);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  std::string path;
};

struct Original {
  ModelPtr mj;
  std::string xml;  ///< normalised
};

Result<Original> ReadOriginal(const Path& mjcf) {
  const std::lock_guard lock(XmlMutex());
  char message[1000] = "";
  Original original;
  original.mj.reset(mj_loadXML(mjcf.c_str(), nullptr, message, sizeof message));
  if (!original.mj) return Fail(Code::kInvalidArgument, fmt::format("MuJoCo refuses {}: {}", mjcf.string(), message));
  const TemporaryFile saved;
  if (!mj_saveLastXML(saved.path.c_str(), original.mj.get(), message, sizeof message))
    return Fail(Code::kInternal, fmt::format("normalise {}: {}", mjcf.string(), message));
  ETUDE_ASSIGN_OR_RETURN(original.xml, ReadTextFile(saved.path));
  return original;
}

/// The robot alone, compiled, to look names and values up in.
Result<ModelPtr> CompileAlone(RobotXml& xml) {
  const std::string text = fmt::format(
      "<mujoco><compiler angle=\"radian\" autolimits=\"true\"/><default>{}</default><asset>{}</asset>"
      "<worldbody>{}</worldbody></mujoco>",
      xml.Defaults(), xml.Assets(), xml.Body());
  return CompileXml(text, xml.files());
}

/// Turns the user's description into ours, collecting everything that is wrong.
class Builder {
 public:
  Builder(const RobotFile& file, RobotXml& xml, const mjModel* original, const mjModel* alone)
      : file_(file), xml_(xml), original_(original), mj_(alone) {
    model_.name = file.name;
    notes_ = xml.notes();
  }

  Result<LoadedRobot> Build(const std::string& origin) {
    AddJoints();
    AddGripper();
    PrepareGeoms();
    PlaceBase();
    AddTool();
    constexpr double kQuarter = std::numbers::pi / 2;
    const double turn = file_.turn != 0 ? file_.turn : file_.approach_pitch > kQuarter / 2 ? -kQuarter : kQuarter;
    if (std::abs(std::abs(turn) - kQuarter) > 0.01) Wrong("turn: {}: must be pi/2, -pi/2 or 0", turn);
    if (!errors_.empty()) return Fail(Code::kInvalidArgument, fmt::format("{}: {}", origin, fmt::join(errors_, "; ")));
    for (XMLElement* body : xml_.All("body")) model_.bodies.push_back(body->Attribute("name"));
    model_.defaults = xml_.Defaults();
    model_.materials = xml_.Assets();
    model_.body = xml_.Body();
    model_.equality = xml_.Equality() + model_.equality;
    model_.tendon = xml_.Tendon();
    model_.files = xml_.files();
    model_.approach_pitch = file_.approach_pitch;
    model_.turned_pitch = file_.approach_pitch + turn;
    return LoadedRobot{std::move(model_), std::move(notes_)};
  }

 private:
  template <class... Args>
  void Wrong(fmt::format_string<Args...> text, Args&&... args) {
    errors_.push_back(fmt::format(text, std::forward<Args>(args)...));
  }
  /// Id in the compiled robot, or -1 and an error with the nearest name.
  int Id(mjtObj type, const char* what, const std::string& name) {
    const int id = mj_name2id(mj_, type, name.c_str());
    if (id >= 0) return id;
    std::vector<std::string> names;
    const int count = type == mjOBJ_JOINT ? mj_->njnt : type == mjOBJ_BODY ? mj_->nbody : mj_->nsite;
    for (int i = 0; i < count; ++i)
      if (const char* candidate = mj_id2name(mj_, type, i)) names.emplace_back(candidate);
    const std::string nearest = NearestMatch(name, names);
    Wrong("no {} '{}'{}", what, name, nearest.empty() ? "" : ", did you mean '" + nearest + "'?");
    return -1;
  }

  void AddMotor(const std::string& joint, double limit) {
    model_.actuator += fmt::format("<motor name=\"{0}\" joint=\"{0}\" ctrlrange=\"{1} {2}\"/>\n", joint, -limit, limit);
  }

  /// N m that the MJCF's own actuator of the joint can give, 0 when it does not say.
  double OwnTorque(const std::string& joint) const {
    const int id = mj_name2id(original_, mjOBJ_JOINT, joint.c_str());
    double most = 0;
    for (int u = 0; u < original_->nu; ++u) {
      if (original_->actuator_trntype[u] != mjTRN_JOINT || original_->actuator_trnid[2 * u] != id) continue;
      const double gear = std::abs(original_->actuator_gear[6 * u]);
      const mjtNum *force = original_->actuator_forcerange + 2 * u, *control = original_->actuator_ctrlrange + 2 * u;
      if (original_->actuator_forcelimited[u]) most = gear * std::max(std::abs(force[0]), std::abs(force[1]));
      const bool motor = original_->actuator_biastype[u] == mjBIAS_NONE;
      if (most == 0 && motor && original_->actuator_ctrllimited[u])
        most = gear * original_->actuator_gainprm[mjNGAIN * u] * std::max(std::abs(control[0]), std::abs(control[1]));
    }
    return most;
  }

  void AddJoints() {
    const std::size_t n = file_.joints.size();
    if (n < 6) Wrong("joints: {} of them, a pose of the hand needs 6 or more", n);
    if (file_.home.size() != n) Wrong("home: {} angles for {} joints", file_.home.size(), n);
    if (!file_.torque.empty() && file_.torque.size() != n) Wrong("torque: {} for {} joints", file_.torque.size(), n);
    if (!file_.speed.empty() && file_.speed.size() != n) Wrong("speed: {} for {} joints", file_.speed.size(), n);
    model_.joints = file_.joints;
    model_.q_home = file_.home;
    model_.joint_speed = file_.speed.empty() ? std::vector<double>(n, kSpeedIfUnknown) : file_.speed;
    for (std::size_t i = 0; i < n; ++i) AddJoint(i);
  }

  void AddJoint(std::size_t i) {
    const std::string& name = file_.joints[i];
    const int id = Id(mjOBJ_JOINT, "joint", name);
    if (id < 0) return;
    if (mj_->jnt_type[id] != mjJNT_HINGE) Wrong("joint '{}' is not a hinge", name);
    double low = mj_->jnt_range[2 * id], high = mj_->jnt_range[2 * id + 1];
    if (!mj_->jnt_limited[id]) {
      low = -2 * std::numbers::pi, high = 2 * std::numbers::pi;
      XMLElement* joint = xml_.Find("joint", name);
      joint->SetAttribute("limited", "true");
      joint->SetAttribute("range", fmt::format("{} {}", low, high).c_str());
      notes_.push_back(fmt::format("joint '{}' has no range: two turns are allowed", name));
    }
    if (i < file_.home.size() && (file_.home[i] <= low || file_.home[i] >= high))
      Wrong("home: {} of joint '{}' is not within {:.3f} .. {:.3f}", file_.home[i], name, low, high);
    const double torque = i < file_.torque.size() ? file_.torque[i] : OwnTorque(name);
    if (!(torque > 0)) Wrong("joint '{}' has no torque limit in the MJCF: give `torque`", name);
    AddMotor(name, torque);
  }

  void AddGripper() {
    const RobotFile::Gripper& gripper = file_.gripper;
    if (gripper.open == gripper.closed) Wrong("gripper: open and closed are the same");
    if (!(gripper.force > 0)) Wrong("gripper.force: {} must be > 0", gripper.force);
    if (gripper.fingers.size() < 2) Wrong("gripper.fingers: at least two groups of bodies");
    for (const auto& group : gripper.fingers)
      for (const std::string& body : group) Id(mjOBJ_BODY, "body", body);
    Id(mjOBJ_JOINT, "joint", gripper.joint);
    const std::string own = xml_.Equality();
    for (const auto& [joint, factor] : gripper.coupled) {
      Id(mjOBJ_JOINT, "joint", joint);
      model_.coupled_joints.push_back({joint, factor});
      if (own.find(fmt::format("\"{}\"", joint)) != std::string::npos) continue;
      model_.equality += fmt::format(
          "<joint joint1=\"{}\" joint2=\"{}\" polycoef=\"0 {} 0 0 0\" solref=\"0.004 1\" "
          "solimp=\"0.98 0.999 0.001\"/>\n",
          joint, gripper.joint, factor);
    }
    AddMotor(gripper.joint, 1.5 * gripper.force);
    model_.gripper_joints = {gripper.joint};
    model_.gripper_open = gripper.open;
    model_.gripper_closed = gripper.closed;
    model_.close_torque = std::copysign(gripper.force, gripper.closed - gripper.open);
    model_.open_torque = -model_.close_torque;
    model_.finger_groups = gripper.fingers;
    NoteLooseJoints();
  }

  void NoteLooseJoints() {
    std::set<std::string> known(file_.joints.begin(), file_.joints.end());
    known.insert(file_.gripper.joint);
    for (const auto& [joint, factor] : file_.gripper.coupled) known.insert(joint);
    for (int i = 0; i < mj_->njnt; ++i)
      if (const char* name = mj_id2name(mj_, mjOBJ_JOINT, i); !name || !known.contains(name))
        notes_.push_back(
            fmt::format("joint '{}' is neither the arm's nor the gripper's: it hangs loose", name ? name : ""));
  }

  /// What collides gets the contact types of our scenes: the robot meets table and objects, not itself.
  void PrepareGeoms() {
    static const std::set<int> kKnown{mjGEOM_BOX, mjGEOM_SPHERE, mjGEOM_CAPSULE, mjGEOM_CYLINDER, mjGEOM_MESH};
    int colliding = 0;
    for (XMLElement* geom : xml_.All("geom")) {
      const char* name = geom->Attribute("name");
      const int id = mj_name2id(mj_, mjOBJ_GEOM, name);
      const bool collides = id >= 0 && (mj_->geom_contype[id] || mj_->geom_conaffinity[id]);
      if (!collides) continue;
      ++colliding;
      if (!kKnown.contains(mj_->geom_type[id]))
        Wrong("geom '{}' collides as neither box, sphere, capsule, cylinder nor mesh", name);
      geom->SetAttribute("contype", 2);
      geom->SetAttribute("conaffinity", 1);
    }
    if (colliding == 0) Wrong("no geom of the robot collides (contype and conaffinity are 0)");
  }

  void PlaceBase() {
    if (file_.base.position.size() != 3) return Wrong("base.position: three numbers");
    const Eigen::Quaterniond q(Eigen::AngleAxisd(file_.base.yaw, Vector3d::UnitZ()));
    xml_.root()->SetAttribute("pos", fmt::format("{}", fmt::join(file_.base.position, " ")).c_str());
    xml_.root()->SetAttribute("quat", fmt::format("{} {} {} {}", q.w(), q.x(), q.y(), q.z()).c_str());
  }

  /// E in the tool's body: x back along the hand, y along the opening.
  void AddTool() {
    const RobotFile::Tool& tool = file_.tool;
    if (tool.site.empty() == tool.body.empty()) return Wrong("tool: a site or a body");
    if (tool.position.size() != 3 || tool.approach.size() != 3 || tool.opening.size() != 3)
      return Wrong("tool: position, approach and opening have three numbers each");
    Pose X_BS;
    int body = -1;
    if (!tool.site.empty()) {
      const int site = Id(mjOBJ_SITE, "site", tool.site);
      if (site < 0) return;
      body = mj_->site_bodyid[site];
      const mjtNum *p = mj_->site_pos + 3 * site, *q = mj_->site_quat + 4 * site;
      X_BS = {Vector3d(p[0], p[1], p[2]), Eigen::Quaterniond(q[0], q[1], q[2], q[3])};
    } else {
      body = Id(mjOBJ_BODY, "body", tool.body);
      if (body < 0) return;
    }
    const Vector3d x = -Vector3d::Map(tool.approach.data()).normalized();
    const Vector3d opening = Vector3d::Map(tool.opening.data());
    const Vector3d y = (opening - x * x.dot(opening)).normalized();
    if (!x.allFinite() || !y.allFinite()) return Wrong("tool: approach and opening must be apart and not zero");
    Eigen::Matrix3d R_SE;
    R_SE << x, y, x.cross(y);
    Pose X_BE = X_BS * Pose{Vector3d::Map(tool.position.data()), Eigen::Quaterniond(R_SE)};
    if (OpensTheOtherWay(body, X_BE)) X_BE.q = X_BE.q * Eigen::AngleAxisd(std::numbers::pi, Vector3d::UnitX());
    XMLElement* site = xml_.Find("body", mj_id2name(mj_, mjOBJ_BODY, body))->InsertNewChildElement("site");
    site->SetAttribute("name", kToolSite);
    site->SetAttribute("pos", fmt::format("{} {} {}", X_BE.p.x(), X_BE.p.y(), X_BE.p.z()).c_str());
    site->SetAttribute("quat", fmt::format("{} {} {} {}", X_BE.q.w(), X_BE.q.x(), X_BE.q.y(), X_BE.q.z()).c_str());
    site->SetAttribute("size", "0.004");
    site->SetAttribute("group", 4);
    model_.tool_site = kToolSite;
  }

  /// A gripper may be turned by half a turn. The tasks ask for y_E along -x of the world; of the two ways the one
  /// that is nearer to it at home saves the arm that turn.
  bool OpensTheOtherWay(int body, const Pose& X_BE) const {
    if (!errors_.empty()) return false;
    const DataPtr data(mj_makeData(mj_));
    for (std::size_t i = 0; i < file_.joints.size(); ++i)
      data->qpos[mj_->jnt_qposadr[mj_name2id(mj_, mjOBJ_JOINT, file_.joints[i].c_str())]] = file_.home[i];
    mj_kinematics(mj_, data.get());
    const auto rotation = [&](int of) {
      const mjtNum* q = data->xquat + 4 * of;
      return Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
    };
    const int root = mj_name2id(mj_, mjOBJ_BODY, xml_.root()->Attribute("name"));
    const Eigen::Quaterniond base(Eigen::AngleAxisd(file_.base.yaw, Vector3d::UnitZ()));
    const Vector3d y_W = base * rotation(root).conjugate() * rotation(body) * X_BE.q * Vector3d::UnitY();
    return y_W.x() > 0;
  }

  const RobotFile& file_;
  RobotXml& xml_;
  const mjModel* original_;
  const mjModel* mj_;
  assets::RobotModel model_;
  std::vector<std::string> notes_, errors_;
};

}  // namespace

bool IsRobotFile(const std::string& robot) { return robot.ends_with(".yaml"); }

Result<LoadedRobot> LoadRobot(const Path& yaml) {
  InstallHandlers();
  ETUDE_ASSIGN_OR_RETURN(const RobotFile file, LoadConfig<RobotFile>(yaml));
  if (file.joints.empty()) return Fail(Code::kInvalidArgument, fmt::format("{}: joints: none named", yaml.string()));
  const Path mjcf = yaml.parent_path() / file.mjcf;
  if (file.mjcf.empty() || !std::filesystem::is_regular_file(mjcf))
    return Fail(Code::kNotFound, fmt::format("{}: mjcf: no file '{}'", yaml.string(), mjcf.string()));
  ETUDE_ASSIGN_OR_RETURN(const Original original, ReadOriginal(mjcf));
  ETUDE_ASSIGN_OR_RETURN(RobotXml xml, RobotXml::Parse(original.xml, mjcf.parent_path(), file.joints[0]));
  ETUDE_ASSIGN_OR_RETURN(const ModelPtr alone, CompileAlone(xml));
  return Builder(file, xml, original.mj.get(), alone.get()).Build(yaml.string());
}

MassReport WeighRobot(const Scene& scene) {
  constexpr double kHeaviest = 100, kWidest = 0.7, kNarrowest = 5e-4;  // kg; m, radius of gyration
  const mjModel* mj = scene.model().mj.get();
  MassReport report;
  for (std::size_t i = 1; i < scene.arm().bodies.size(); ++i) {
    const std::string& name = scene.arm().bodies[i];
    const int body = scene.model().BodyId(name);
    const double mass = mj->body_mass[body];
    report.total += mass;
    const auto inertia = Vector3d::Map(mj->body_inertia + 3 * body);
    const double widest = std::sqrt(inertia.maxCoeff() / mass), narrowest = std::sqrt(inertia.minCoeff() / mass);
    if (mass > kHeaviest) report.implausible.push_back(fmt::format("{} has {:g} kg", name, mass));
    if (widest > kWidest || narrowest < kNarrowest)
      report.implausible.push_back(fmt::format("{} has radii of gyration {:g} .. {:g} m", name, narrowest, widest));
  }
  return report;
}

}  // namespace etude::sim
