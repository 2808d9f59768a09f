// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/robot_builder.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <set>

#include "worker/sim/gripper_loop.h"

namespace etude::sim {
namespace {

using Eigen::Vector3d;
using tinyxml2::XMLElement;

constexpr double kSpeedIfUnknown = 2.0;  ///< rad/s
constexpr const char* kToolSite = "etude_tool";
constexpr double kQuarter = std::numbers::pi / 2, kWholeTurn = 2 * std::numbers::pi;
constexpr std::size_t kFewestJoints = 5;
constexpr double kDampingShare = 0.5;                ///< of a joint's torque, that its damping may take at most
constexpr double kLeastStroke = 1e-3;                ///< m or rad, of a finger from open to closed
constexpr double kStill = 1e-7;                      ///< m or rad, that rounding makes of what does not move
constexpr int kPoints = 3, kAreas = 4;               ///< condim: contacts without and with friction against turning
constexpr std::array kFriction{1.0, 0.005, 0.0001};  ///< MuJoCo's default
constexpr double kAreaTorsion = 0.02;                ///< m, that friction of our objects

/// Whether the equalities make `joint` go with `driven`, at once or by way of others.
bool GoTogether(const std::string& equality, const std::string& joint, const std::string& driven) {
  tinyxml2::XMLDocument document;
  document.Parse(("<equality>" + equality + "</equality>").c_str());
  const XMLElement* const root = document.RootElement();
  std::set<std::string> known{driven};
  for (std::size_t before = 0; root && before != known.size();) {
    before = known.size();
    for (const auto* item = root->FirstChildElement("joint"); item; item = item->NextSiblingElement("joint")) {
      const std::string a = Attribute(*item, "joint1"), b = Attribute(*item, "joint2");
      if (b.empty() || Attribute(*item, "active") == "false" || (!known.contains(a) && !known.contains(b))) continue;
      known.insert({a, b});
    }
  }
  return known.contains(joint);
}

/// Collects everything that is wrong.
class Builder {
 public:
  Builder(const RobotFile& file, RobotXml& xml, const mjModel* alone) : file_(file), xml_(xml), mj_(alone) {
    model_.name = file.name;
    notes_ = xml.notes();
  }

  Result<LoadedRobot> Build(const std::string& origin) {
    AddJoints();
    AddGripper();
    PrepareGeoms();
    PlaceBase();
    AddTool();
    AddPitches();
    if (file_.masses != "check" && file_.masses != "trust" && file_.masses != kMassesOfCollision)
      Wrong("masses: '{}' is neither check, trust nor {}", file_.masses, kMassesOfCollision);
    if (!errors_.empty()) return Fail(Code::kInvalidArgument, fmt::format("{}: {}", origin, fmt::join(errors_, "; ")));
    ETUDE_RETURN_IF_ERROR(FindFollowers());
    CheckStroke();
    if (!errors_.empty()) return Fail(Code::kInvalidArgument, fmt::format("{}: {}", origin, fmt::join(errors_, "; ")));
    for (XMLElement* body : xml_.All("body")) model_.bodies.push_back(body->Attribute("name"));
    model_.defaults = xml_.Defaults();
    model_.materials = xml_.Assets();
    model_.body = xml_.Body();
    model_.equality = xml_.Equality() + model_.equality;
    model_.tendon = xml_.Tendon();
    model_.files = xml_.files();
    return LoadedRobot{std::move(model_), file_.masses == "trust", std::move(notes_), xml_.sources()};
  }

 private:
  template <class... Args>
  void Wrong(fmt::format_string<Args...> text, Args&&... args) {
    errors_.push_back(fmt::format(text, std::forward<Args>(args)...));
  }
  std::string JointName(const std::string& name) const { return xml_.NameOf("joint", name); }
  std::string BodyName(const std::string& name) const { return xml_.NameOf("body", name); }

  /// Id of `name`, in the file called `in_file`, in the compiled robot, or -1 and an error with the nearest name.
  int Id(mjtObj type, const char* kind, const std::string& in_file, const std::string& name) {
    const int id = mj_name2id(mj_, type, name.c_str());
    if (id >= 0) return id;
    std::vector<std::string> names;
    const int count = type == mjOBJ_JOINT ? mj_->njnt : type == mjOBJ_BODY ? mj_->nbody : mj_->nsite;
    for (int i = 0; i < count; ++i)
      if (const char* candidate = mj_id2name(mj_, type, i)) names.emplace_back(candidate);
    Wrong("no {} '{}'{}", kind, in_file, Suggestion(in_file, names));
    return -1;
  }
  int Id(mjtObj type, const char* kind, const std::string& in_file) {
    return Id(type, kind, in_file, xml_.NameOf(kind, in_file));
  }

  void AddMotor(const std::string& joint, double limit) {
    model_.actuator += fmt::format("<motor name=\"{0}\" joint=\"{0}\" ctrlrange=\"{1} {2}\"/>\n", joint, -limit, limit);
  }

  void AddJoints() {
    const std::size_t n = file_.joints.size();
    if (n < kFewestJoints)
      Wrong("joints: {} of them; a hand's place and its turn about the vertical need {}", n, kFewestJoints);
    const auto count = [&](const char* key, std::size_t given) {
      if (given != 0 && given != n) Wrong("{}: {} for {} joints", key, given, n);
    };
    if (file_.home.size() != n) Wrong("home: {} angles for {} joints", file_.home.size(), n);
    count("torque", file_.torque.size());
    count("speed", file_.speed.size());
    count("armature", file_.armature.size());
    count("damping", file_.damping.size());
    for (const double speed : file_.speed)
      if (!(speed > 0)) Wrong("speed: {} must be > 0", speed);
    for (const std::string& name : file_.joints) model_.joints.push_back(xml_.ArmNameOf("joint", name));
    model_.q_home = file_.home;
    model_.joint_speed = file_.speed.empty() ? std::vector<double>(n, kSpeedIfUnknown) : file_.speed;
    model_.planned_speed = model_.joint_speed;
    for (std::size_t i = 0; i < n; ++i) AddJoint(i);
  }

  void AddJoint(std::size_t i) {
    const std::string& name = file_.joints[i];
    const int id = Id(mjOBJ_JOINT, "joint", name, model_.joints[i]);
    if (id < 0) return;
    XMLElement* joint = xml_.Find("joint", model_.joints[i]);
    if (mj_->jnt_type[id] != mjJNT_HINGE) Wrong("joint '{}' is not a hinge", name);
    double low = mj_->jnt_range[2 * id], high = mj_->jnt_range[2 * id + 1];
    if (!mj_->jnt_limited[id]) {
      low = -2 * std::numbers::pi, high = 2 * std::numbers::pi;
      joint->SetAttribute("limited", "true");
      joint->SetAttribute("range", fmt::format("{} {}", low, high).c_str());
      notes_.push_back(fmt::format("joint '{}' has no range: two turns are allowed", name));
    }
    if (i < file_.home.size() && (file_.home[i] <= low || file_.home[i] >= high))
      Wrong("home: {} of joint '{}' is not within {:.3f} .. {:.3f}", file_.home[i], name, low, high);
    const auto set = [&](const char* key, const std::vector<double>& values) {
      if (i >= values.size()) return;
      if (!(values[i] >= 0)) Wrong("{}: {} of joint '{}' must be >= 0", key, values[i], name);
      joint->SetAttribute(key, fmt::format("{}", values[i]).c_str());
    };
    set("armature", file_.armature);
    set("damping", file_.damping);
    const double torque = i < file_.torque.size() ? file_.torque[i] : xml_.ActuatorLimit(model_.joints[i]);
    if (!(torque > 0)) Wrong("joint '{}' has no torque limit in the MJCF: give `torque`", name);
    AddMotor(model_.joints[i], torque);
    const double damping = i < file_.damping.size() ? file_.damping[i] : mj_->dof_damping[mj_->jnt_dofadr[id]];
    LimitSpeed(i, torque, damping);
  }

  /// What a joint's damping takes of its torque is lost for moving and holding the arm.
  void LimitSpeed(std::size_t i, double torque, double damping) {
    const double most = kDampingShare * torque / damping;
    if (i >= model_.planned_speed.size() || !(most < model_.planned_speed[i])) return;
    notes_.push_back(fmt::format(
        "joint '{}' is planned for {:.2f} rad/s at most: at {:.2f} its damping of {:g} N m s/rad would take {:.0f} % "
        "of "
        "its {:g} N m (give `damping` if it has less)",
        file_.joints[i], most, model_.joint_speed[i], damping, 100 * damping * model_.joint_speed[i] / torque, torque));
    model_.planned_speed[i] = most;
  }

  void AddGripper() {
    const RobotFile::Gripper& gripper = file_.gripper;
    if (gripper.open == gripper.closed) Wrong("gripper: open and closed are the same");
    if (!(gripper.force > 0)) Wrong("gripper.force: {} must be > 0", gripper.force);
    if (gripper.fingers.size() < 2) Wrong("gripper.fingers: at least two groups of bodies");
    for (const auto& group : gripper.fingers) {
      if (group.empty()) Wrong("gripper.fingers: a group without bodies would never touch anything");
      for (const std::string& body : group) Id(mjOBJ_BODY, "body", body);
      auto& names = model_.finger_groups.emplace_back();
      for (const std::string& body : group) names.push_back(BodyName(body));
    }
    const std::string driven = JointName(gripper.joint);
    Id(mjOBJ_JOINT, "joint", gripper.joint);
    for (const auto& [joint, factor] : gripper.coupled) Couple(joint, factor, driven);
    AddMotor(driven, 1.5 * gripper.force);
    model_.gripper_joints = {driven};
    model_.gripper_open = gripper.open;
    model_.gripper_closed = gripper.closed;
    model_.close_torque = std::copysign(gripper.force, gripper.closed - gripper.open);
    model_.open_torque = -model_.close_torque;
  }

  /// Closed chains make joints follow that nobody has to name: their place is what collision checks need.
  Status FindFollowers() {
    if (LooseJoints().empty()) return {};
    ETUDE_ASSIGN_OR_RETURN(const ModelPtr whole, CompileAlone(xml_, {}, xml_.Equality() + model_.equality));
    std::vector<std::string> words;
    for (const Follower& follower : MeasureFollowers(*whole, model_)) {
      model_.coupled_joints.push_back({.joint = follower.joint, .factor = follower.factor, .offset = follower.offset});
      words.push_back(fmt::format("{} by {:.2f} (within {:.3f})", follower.joint, follower.factor, follower.deviation));
    }
    if (!words.empty())
      notes_.push_back(
          fmt::format("found by closing the gripper: {} follow {}", fmt::join(words, ", "), model_.gripper_joints[0]));
    for (const std::string& name : LooseJoints())
      notes_.push_back(fmt::format("joint '{}' is neither the arm's nor the gripper's: it hangs loose", name));
    return {};
  }

  /// The joint's position in the model as it is written, MJCF's ref.
  double Reference(int joint) const { return joint < 0 ? 0 : mj_->qpos0[mj_->jnt_qposadr[joint]]; }

  /// Unless the file couples the joint itself. Either way MuJoCo couples what joints are away from their references.
  void Couple(const std::string& joint, double factor, const std::string& driven) {
    const double of_driven = Reference(mj_name2id(mj_, mjOBJ_JOINT, driven.c_str()));
    const double offset = Reference(Id(mjOBJ_JOINT, "joint", joint)) - factor * of_driven;
    const std::string name = JointName(joint);
    model_.coupled_joints.push_back({.joint = name, .factor = factor, .offset = offset});
    if (GoTogether(xml_.Equality() + model_.equality, name, driven)) return;
    model_.equality += fmt::format(
        "<joint joint1=\"{}\" joint2=\"{}\" polycoef=\"0 {} 0 0 0\" solref=\"0.004 1\" "
        "solimp=\"0.98 0.999 0.001\"/>\n",
        name, driven, factor);
  }

  /// Joints that are neither the arm's nor the gripper's, so far.
  std::vector<std::string> LooseJoints() const {
    std::set<std::string> known(model_.joints.begin(), model_.joints.end());
    known.insert(model_.gripper_joints.at(0));
    for (const auto& coupled : model_.coupled_joints) known.insert(coupled.joint);
    std::vector<std::string> loose;
    for (int i = 0; i < mj_->njnt; ++i)
      if (const char* name = mj_id2name(mj_, mjOBJ_JOINT, i); !name || !known.contains(name))
        loose.emplace_back(name ? name : "");
    return loose;
  }

  /// What collides gets the contact types of our scenes: the robot meets table and objects, not itself.
  void PrepareGeoms() {
    static const std::set<int> kKnown{mjGEOM_BOX, mjGEOM_SPHERE, mjGEOM_CAPSULE, mjGEOM_CYLINDER, mjGEOM_MESH};
    int colliding = 0;
    for (XMLElement* geom : xml_.All("geom")) {
      const char* name = geom->Attribute("name");
      const int id = mj_name2id(mj_, mjOBJ_GEOM, name);
      if (id < 0 || !Collides(mj_, id)) continue;
      ++colliding;
      if (!kKnown.contains(mj_->geom_type[id]))
        Wrong("geom '{}' collides as neither box, sphere, capsule, cylinder nor mesh", name);
      geom->SetAttribute("contype", 2);
      geom->SetAttribute("conaffinity", 1);
      NameFriction(*geom, id);
      if (IsFinger(id)) HoldByAnArea(*geom, id);
    }
    if (!held_by_points_.empty())
      notes_.push_back(fmt::format(
          "{} of the fingers decide alone on their contacts (priority) and hold by points (condim {}), about which an "
          "object would swing: they get friction against turning as our objects have",
          fmt::join(held_by_points_, ", "), kPoints));
    if (colliding == 0) Wrong("no geom of the robot collides (contype and conaffinity are 0)");
    CheckWhatIsSeen();
    NoteBlindBodies();
  }

  void CheckWhatIsSeen() {
    constexpr int kDrawn = 3;  // groups that MuJoCo draws where it is not told otherwise
    bool seen = false;
    for (int id = 0; id < mj_->ngeom; ++id) seen = seen || (mj_->geom_bodyid[id] > 0 && mj_->geom_group[id] < kDrawn);
    if (!seen) Wrong("no geom of the robot is drawn: pictures have those of groups 0 to {}", kDrawn - 1);
  }

  /// Bodies of which nothing collides: planner and judge take them for air.
  void NoteBlindBodies() {
    std::vector<std::string> blind;
    for (int body = 1; body < mj_->nbody; ++body) {
      const int first = mj_->body_geomadr[body], count = mj_->body_geomnum[body];
      bool collides = count == 0;
      for (int id = first; id < first + count; ++id) collides = collides || Collides(mj_, id);
      if (!collides) blind.emplace_back(mj_id2name(mj_, mjOBJ_BODY, body));
    }
    if (!blind.empty())
      notes_.push_back(
          fmt::format("of {} no geom collides (contype and conaffinity are 0): it is planned and judged as "
                      "if {} not there",
                      fmt::join(blind, ", "), blind.size() > 1 ? "they were" : "it were"));
  }

  /// MuJoCo's own friction stands in no text of the file, where `world.friction` would find it.
  void NameFriction(XMLElement& geom, int id) const {
    if (!geom.Attribute("friction") && std::equal(kFriction.begin(), kFriction.end(), mj_->geom_friction + 3 * id))
      geom.SetAttribute("friction", fmt::format("{}", fmt::join(kFriction, " ")).c_str());
  }

  bool IsFinger(int geom) const {
    const std::string body = mj_id2name(mj_, mjOBJ_BODY, mj_->geom_bodyid[geom]);
    return std::ranges::any_of(model_.finger_groups,
                               [&](const auto& group) { return std::ranges::find(group, body) != group.end(); });
  }

  /// A fingertip holds by an area. Without a priority the object's friction counts, too; with one, the finger's alone.
  void HoldByAnArea(XMLElement& geom, int id) {
    if (mj_->geom_priority[id] <= 0 || mj_->geom_condim[id] != kPoints) return;
    const mjtNum* friction = mj_->geom_friction + 3 * id;
    geom.SetAttribute("condim", kAreas);
    geom.SetAttribute("friction",
                      fmt::format("{} {} {}", friction[0], std::max(friction[1], kAreaTorsion), friction[2]).c_str());
    held_by_points_.emplace_back(geom.Attribute("name"));
  }

  /// The root's turn in its own file.
  Eigen::Quaterniond RootTurn() const {
    const mjtNum* q = mj_->body_quat + 4 * mj_name2id(mj_, mjOBJ_BODY, xml_.root()->Attribute("name"));
    return Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
  }

  /// By `yaw` alone where it stands upright; a first link whose base was fused into the world keeps its own turn.
  Eigen::Quaterniond BaseTurn() const {
    constexpr double kUpright = 1 - 1e-6;  // cosine
    const Eigen::Quaterniond yaw(Eigen::AngleAxisd(file_.base.yaw, Vector3d::UnitZ()));
    return (RootTurn() * Vector3d::UnitZ()).z() > kUpright ? yaw : yaw * RootTurn();
  }

  void PlaceBase() {
    if (file_.base.position.size() != 3) return Wrong("base.position: three numbers");
    if (!(std::abs(file_.base.yaw) <= kWholeTurn))
      Wrong("base.yaw: {}: rad, and more than a whole turn", file_.base.yaw);
    SetPose(*xml_.root(), {Vector3d::Map(file_.base.position.data()), BaseTurn()});
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
    const Vector3d approach = Vector3d::Map(tool.approach.data()), opening = Vector3d::Map(tool.opening.data());
    const Vector3d x = -approach.normalized(), across = opening - x * x.dot(opening);
    // as a condition that numbers which are none do not fulfil; of what has no length `normalized` makes itself
    if (!(approach.norm() > 1e-9 && across.norm() > 1e-6 * opening.norm() && across.allFinite()))
      return Wrong("tool: approach ({}) and opening ({}) must be apart and not zero", fmt::join(tool.approach, ", "),
                   fmt::join(tool.opening, ", "));
    const Vector3d y = across.normalized();
    Eigen::Matrix3d R_SE;
    R_SE << x, y, x.cross(y);
    Pose X_BE = X_BS * Pose{Vector3d::Map(tool.position.data()), Eigen::Quaterniond(R_SE)};
    if (OpensTheOtherWay(body, X_BE)) X_BE.q = X_BE.q * Eigen::AngleAxisd(std::numbers::pi, Vector3d::UnitX());
    const char* const carrier = mj_id2name(mj_, mjOBJ_BODY, body);
    XMLElement* const element = carrier ? xml_.Find("body", carrier) : nullptr;
    if (!element) return Wrong("tool: body '{}' is none of the robot's", carrier ? carrier : "");
    XMLElement* site = element->InsertNewChildElement("site");
    site->SetAttribute("name", kToolSite);
    SetPose(*site, X_BE);
    site->SetAttribute("size", "0.004");
    site->SetAttribute("group", 4);
    model_.tool_site = kToolSite;
    tool_body_ = body;
    CheckHand(body);
  }

  /// Where a hand reaches to is measured on what collides of it: fingers, and a palm that is rigid with the tool.
  void CheckHand(int tool) {
    bool fingers = false, palm = false;
    for (int geom = 0; geom < mj_->ngeom; ++geom) {
      if (!Collides(mj_, geom)) continue;
      const bool rigid = mj_->body_weldid[mj_->geom_bodyid[geom]] == mj_->body_weldid[tool];
      fingers = fingers || IsFinger(geom);
      palm = palm || (rigid && !IsFinger(geom));
    }
    if (!fingers)
      Wrong("gripper.fingers: no geom of theirs collides (contype and conaffinity are 0): they hold nothing");
    if (!palm)
      Wrong("tool: no geom of the palm collides: neither of body '{}' nor of what is fixed to it",
            mj_id2name(mj_, mjOBJ_BODY, tool));
  }

  /// Arm joints that move a body.
  std::set<int> JointsBelow(int body) const {
    std::set<int> joints;
    for (const std::string& name : model_.joints) {
      const int joint = mj_name2id(mj_, mjOBJ_JOINT, name.c_str());
      for (int at = body; at > 0; at = mj_->body_parentid[at])
        if (mj_->jnt_bodyid[joint] == at) joints.insert(joint);
    }
    return joints;
  }

  /// Fingers that stay where they are close on nothing, and a tool that goes with them is nowhere: what is planned asks
  /// how far the hand reaches when it is open, and when it is closed.
  void CheckStroke() {
    const std::vector<double> stroke = StrokeOfBodies(*mj_, model_);
    const auto moved = [&](int body) { return stroke[static_cast<std::size_t>(body)]; };
    const RobotFile::Gripper& gripper = file_.gripper;
    if (moved(tool_body_) > kStill)
      Wrong("gripper.joint: '{}' moves body '{}', which carries the tool: name a joint that moves the fingers alone",
            gripper.joint, mj_id2name(mj_, mjOBJ_BODY, tool_body_));
    const std::set<int> of_hand = JointsBelow(tool_body_);
    for (int geom = 0; geom < mj_->ngeom; ++geom) {
      const int body = mj_->geom_bodyid[geom];
      if (Collides(mj_, geom) && IsFinger(geom) && moved(body) >= kLeastStroke && JointsBelow(body) == of_hand) return;
    }
    std::vector<std::string> fingers;
    for (const auto& group : gripper.fingers) fingers.insert(fingers.end(), group.begin(), group.end());
    Wrong(
        "gripper: nothing that collides of the hand's fingers ({}) moves when joint '{}' goes from open ({:g}) to "
        "closed ({:g}): name the joint that moves them, or those that follow it in gripper.coupled",
        fmt::join(fingers, ", "), gripper.joint, gripper.open, gripper.closed);
  }

  /// A gripper may be turned by half a turn. The tasks ask for y_E along -x of the world; of the two ways the one
  /// that is nearer to it at home saves the arm that turn.
  bool OpensTheOtherWay(int body, const Pose& X_BE) const {
    if (!errors_.empty()) return false;
    const DataPtr data(mj_makeData(mj_));
    for (std::size_t i = 0; i < model_.joints.size(); ++i)
      data->qpos[mj_->jnt_qposadr[mj_name2id(mj_, mjOBJ_JOINT, model_.joints[i].c_str())]] = file_.home[i];
    mj_kinematics(mj_, data.get());
    const auto rotation = [&](int of) {
      const mjtNum* q = data->xquat + 4 * of;
      return Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
    };
    const Vector3d y_W = BaseTurn() * RootTurn().conjugate() * rotation(body) * X_BE.q * Vector3d::UnitY();
    return y_W.x() > 0;
  }

  void AddPitches() {
    const double turn = file_.turn != 0 ? file_.turn : file_.approach_pitch > kQuarter / 2 ? -kQuarter : kQuarter;
    if (!(std::abs(file_.approach_pitch) <= kWholeTurn / 2))
      Wrong("approach_pitch: {}: rad, and more than half a turn", file_.approach_pitch);
    if (file_.approach_pitch < 0) Wrong("approach_pitch: {}: 0 (level) or more", file_.approach_pitch);
    if (std::abs(std::abs(turn) - kQuarter) > 0.01) Wrong("turn: {}: must be pi/2, -pi/2 or 0", turn);
    if (file_.approach_pitch == 0 && turn < 0)
      Wrong("turn: {}: a level hand turns an object over by pointing down: pi/2 or 0", turn);
    model_.approach_pitch = file_.approach_pitch;
    model_.turned_pitch = file_.approach_pitch + turn;
    if (file_.joints.size() >= kJointsOfAnyPose) return;
    if (std::abs(file_.approach_pitch - kQuarter) > 0.01)
      Wrong("approach_pitch: {}: with {} joints only a hand that points straight down (1.5708) can be turned any way",
            file_.approach_pitch, file_.joints.size());
    notes_.push_back(
        fmt::format("{} joints: the hand points straight down and goes to any place; tasks that turn an object over "
                    "(rotate, put_down) are not for this arm",
                    file_.joints.size()));
  }

  const RobotFile& file_;
  RobotXml& xml_;
  const mjModel* mj_;
  assets::RobotModel model_;
  std::vector<std::string> notes_, errors_, held_by_points_;
  int tool_body_ = 0;  ///< that carries the tool
};

}  // namespace

Result<ModelPtr> CompileAlone(const RobotXml& xml, const std::string& settings, const std::string& equality) {
  const std::string text = fmt::format(
      "<mujoco><compiler angle=\"radian\" autolimits=\"true\"{}/><default>{}</default><asset>{}</asset>"
      "<worldbody>{}</worldbody><tendon>{}</tendon><equality>{}</equality></mujoco>",
      settings, xml.Defaults(), xml.Assets(), xml.Body(), equality.empty() ? "" : xml.Tendon(), equality);
  auto model = CompileXml(text, xml.files());
  if (model) return model;
  return Fail(Code::kInvalidArgument, fmt::format("{}: {}", xml.file().string(), model.error().message));
}

Result<LoadedRobot> BuildRobot(const RobotFile& file, RobotXml& xml, const mjModel* alone, const std::string& origin) {
  return Builder(file, xml, alone).Build(origin);
}

}  // namespace etude::sim
