// SPDX-License-Identifier: Apache-2.0
// Private to worker/sim: MuJoCo's model and data, and the addresses of what we use in them.
#pragma once

#include <mujoco/mujoco.h>

#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "worker/assets/scene_description.h"
#include "worker/sim/arm_tree.h"
#include "worker/sim/controller.h"
#include "worker/sim/scene.h"
#include "worker/sim/world.h"

namespace etude::sim {

struct ModelDeleter {
  void operator()(mjModel* model) const { mj_deleteModel(model); }
};
struct DataDeleter {
  void operator()(mjData* data) const { mj_deleteData(data); }
};
using ModelPtr = std::unique_ptr<mjModel, ModelDeleter>;
using DataPtr = std::unique_ptr<mjData, DataDeleter>;

/// Whether a geom can touch anything; one that cannot is visual.
inline bool Collides(const mjModel* mj, int geom) { return mj->geom_contype[geom] || mj->geom_conaffinity[geom]; }

struct Scene::Model {
  ModelPtr mj;
  assets::RobotModel robot;
  std::vector<int> arm_q, arm_v, arm_u;     ///< addresses in qpos, qvel, ctrl
  std::vector<double> soft_low, soft_high;  ///< rad, where the arm's soft stops begin
  bool has_friction = false;                ///< dry, in some joint of the arm
  std::vector<int> gripper_q;               ///< driven joints
  int gripper_u = -1;
  struct CoupledJoint {
    int address = -1;
    double factor = 0, offset = 0;  ///< of the driven joint, see assets::RobotModel
  };
  std::vector<CoupledJoint> coupled_q;
  int tool_site = -1;
  struct FreeBody {
    int body = -1, q = -1, v = -1;
  };
  std::map<std::string, FreeBody> objects;
  std::unordered_map<std::string, int> bodies;  ///< all, by name: MuJoCo's own search is linear

  ArmTree tree;
  std::vector<int> arm_bodies;  ///< indices in the tree of robot.bodies

  int BodyId(const std::string& name) const;  ///< checked
  DataPtr NewData() const;                    ///< checked
  /// Home arm, open gripper.
  void SetHome(mjtNum* qpos) const;
  void SetArm(mjtNum* qpos, const Eigen::VectorXd& q) const;
  /// All gripper joints; `gripper` is 0 open .. 1 closed.
  void SetGripper(mjtNum* qpos, double gripper) const;
  Pose ToolPose(const mjData* data) const;
  Pose BodyPose(const mjData* data, int body) const;
  /// (6, n) of the tool, linear rows first. `scratch` holds 6 * nv numbers.
  void ToolJacobian(const mjData* data, std::vector<double>& scratch, Eigen::MatrixXd& J) const;
};

struct World::State {
  DataPtr mj;
  ControllerConfig config;
  ControlState control;  ///< scratch of Step, kept for its memory
  std::vector<double> scratch, full_inertia;
  Eigen::VectorXd demanded;       ///< (n) N m, see World::demanded_torque
  std::vector<int> arm_body_ids;  ///< of ArmInfo::bodies
  /// Commands under way to the arm, the oldest first; at most the scene's control_delay.
  struct Command {
    Waypoint target;
    Eigen::Matrix<double, 6, 1> V_WE;
  };
  std::deque<Command> under_way;
  /// See World::Guide; of the step to come only.
  struct Guided {
    Scene::Model::FreeBody body;
    Pose X_WO;
    Eigen::Vector3d v_WO;
  };
  std::optional<Guided> guided;

  void MoveGuided(const mjModel* model);
  void ReadControl(const Scene::Model& model);
};

/// MuJoCo keeps the last XML in a global: held while one is loaded and saved.
std::mutex& XmlMutex();
/// Compiles MJCF with its files in memory. Thread-safe. @error kInternal with MuJoCo's message
Result<ModelPtr> CompileXml(const std::string& mjcf, const std::vector<assets::AssetFile>& assets);

/// MuJoCo's errors abort with a log line, its warnings go to the log. Once per process;
/// thread-safe.
void InstallHandlers();

}  // namespace etude::sim
