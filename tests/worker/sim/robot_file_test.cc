// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/robot_file.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <mujoco/mujoco.h>

#include <filesystem>

#include "services/core/config_reference.h"
#include "services/core/file.h"
#include "services/core/rng.h"
#include "tests/support/replace_in_file.h"
#include "tests/support/temporary_folder.h"
#include "tests/worker/sim/scene_fixture.h"
#include "worker/sim/model.h"

namespace etude::sim {
namespace robot_file_test {

const std::string kSketch = "deploy/robots/sketch.yaml";

TEST(RobotFile, SaysOfEveryKeyWhatItMeansAndInWhichUnit) {
  EXPECT_THAT(MissingFromReference(ConfigReference<RobotFile>()), testing::IsEmpty());
}

TEST(RobotFile, TakesTheRobotOutOfItsFile) {
  const auto loaded = LoadRobot(kSketch);
  ASSERT_TRUE(loaded) << loaded.error().message;
  const assets::RobotModel& robot = loaded->model;
  EXPECT_THAT(robot.bodies,
              testing::ElementsAre("foot", "turret", "upper", "fore", "wrist", "palm_link", "hand", "left", "right"));
  EXPECT_EQ(robot.files.size(), 2u) << "two meshes, one of them used twice";
  EXPECT_EQ(robot.files[0].bytes, *ReadBinaryFile("deploy/robots/sketch/meshes/foot.obj"));
  EXPECT_THAT(robot.actuator, testing::HasSubstr("<motor name=\"lift\" joint=\"lift\" ctrlrange=\"-150 150\"/>"));
  EXPECT_THAT(robot.actuator, testing::Not(testing::HasSubstr("general"))) << "its position actuators are replaced";
  EXPECT_THAT(robot.equality, testing::HasSubstr("right_slide")) << "its own coupling is kept";
  EXPECT_THAT(loaded->notes, testing::ElementsAre(testing::HasSubstr("'floor'")));
  EXPECT_EQ(robot.open_torque, 50) << "opening is towards 0.04";
}

// Masses, inertias, joints and poses are those of the original, default classes and meshes included.
TEST(RobotFile, IsTheSameRobotInOurScene) {
  char message[1000] = "";
  const ModelPtr original(mj_loadXML("deploy/robots/sketch/sketch.xml", nullptr, message, sizeof message));
  ASSERT_TRUE(original) << message;
  const auto scene = SceneOf(kSketch);
  const mjModel* ours = scene->model().mj.get();
  const DataPtr theirs_data(mj_makeData(original.get()));
  Kinematics kinematics(scene);
  Rng rng(3);
  Eigen::VectorXd q(6);
  for (int i = 0; i < 6; ++i) {
    q[i] = rng.Uniform(-1, 1);
    theirs_data->qpos[i] = q[i];
  }
  mj_kinematics(original.get(), theirs_data.get());
  const Eigen::Vector3d base(0, -0.2, 0);
  for (const std::string& name : scene->arm().bodies) {
    const int a = mj_name2id(original.get(), mjOBJ_BODY, name.c_str()), b = scene->model().BodyId(name);
    EXPECT_NEAR(original->body_mass[a], ours->body_mass[b], 1e-9) << name;
    for (int k = 0; k < 3; ++k)
      EXPECT_NEAR(original->body_inertia[3 * a + k], ours->body_inertia[3 * b + k], 1e-6) << name;
    if (name == "left" || name == "right") continue;  // theirs is closed there
    const Pose X = kinematics.BodyPoses(q, 0, {name})[0];
    EXPECT_LT((X.p - base - Eigen::Vector3d::Map(theirs_data->xpos + 3 * a)).norm(), 1e-4) << name;
  }
  for (const char* joint : {"left_slide", "lift", "roll"}) {
    const int a = mj_name2id(original.get(), mjOBJ_JOINT, joint), b = mj_name2id(ours, mjOBJ_JOINT, joint);
    const int da = original->jnt_dofadr[a], db = ours->jnt_dofadr[b];
    EXPECT_EQ(original->dof_armature[da], ours->dof_armature[db]) << joint;
    EXPECT_EQ(original->dof_damping[da], ours->dof_damping[db]) << joint;
    EXPECT_NEAR(original->jnt_range[2 * a + 1], ours->jnt_range[2 * b + 1], 1e-5) << joint;
  }
}

TEST(RobotFile, MeshesCollideAsTheirHulls) {
  int convex = 0;
  for (const Geometry& piece : SceneOf(kSketch)->geometry()) {
    if (piece.shape != Geometry::Shape::kConvex ||
        (piece.body != "foot" && piece.body != "upper" && piece.body != "fore"))
      continue;
    ++convex;
    EXPECT_EQ(piece.vertices.size(), 16u) << piece.name;
  }
  EXPECT_EQ(convex, 3);
}

TEST(RobotFile, TheToolLooksBackAlongTheHandWhicheverWayTheOpeningIsGiven) {
  const auto scene = SceneOf(kSketch);
  Kinematics kinematics(scene);
  const Pose X = kinematics.X_WE(scene->arm().q_home);
  EXPECT_LT((X.q * Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitZ()).norm(), 1e-3) << "the hand points down";
  EXPECT_LT((X.q * Eigen::Vector3d::UnitY() + Eigen::Vector3d::UnitX()).norm(), 1e-3);
}

TEST(RobotFile, MakesTheSameSceneTwice) {
  SceneSpec spec;
  spec.robot = kSketch;
  const auto again = Scene::Build(spec);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ((*again)->sha256(), SceneOf(kSketch)->sha256());
}

/// A copy of the example to break.
class BrokenRobot : public testing::Test {
 protected:
  BrokenRobot() { std::filesystem::copy("deploy/robots", folder_.path(), std::filesystem::copy_options::recursive); }
  void Replace(const std::string& file, const std::string& from, const std::string& to) {
    ReplaceInFile(folder_ / file, from, to);
  }
  /// Its scene. @param friction  of the world
  Result<std::shared_ptr<const Scene>> Build(double friction = 1) const {
    SceneSpec spec;
    spec.robot = (folder_ / "sketch.yaml").string();
    spec.world.friction = friction;
    return Scene::Build(spec);
  }
  Error Load() const {
    const auto loaded = LoadRobot(folder_ / "sketch.yaml");
    EXPECT_FALSE(loaded);
    return loaded ? Error{} : loaded.error();
  }
  TemporaryFolder folder_;
};

TEST_F(BrokenRobot, EverythingWrongIsSaidAtOnce) {
  Replace("sketch.yaml", "bend, roll", "bent, roll");
  Replace("sketch.yaml", "force: 50", "force: 0");
  Replace("sketch.yaml", "[[left], [right]]", "[[left], [write]]");
  Replace("sketch/sketch.xml", "kp=\"500\" forcerange=\"-30 30\"/>", "kp=\"500\"/>");
  const Error error = Load();
  EXPECT_EQ(error.code, Code::kInvalidArgument);
  EXPECT_THAT(error.message, testing::HasSubstr("no joint 'bent', did you mean 'bend'?"));
  EXPECT_THAT(error.message, testing::HasSubstr("gripper.force: 0"));
  EXPECT_THAT(error.message, testing::HasSubstr("no body 'write'"));
  EXPECT_THAT(error.message, testing::HasSubstr("'roll' has no torque limit"));
}

TEST_F(BrokenRobot, AJointThatMayNotMoveIsRefused) {
  Replace("sketch.yaml", "[2.5, 2.5, 2.5, 3, 3, 3]", "[2.5, 0, 2.5, -2, 3, 3]");
  const Error error = Load();
  EXPECT_EQ(error.code, Code::kInvalidArgument);
  EXPECT_THAT(error.message, testing::HasSubstr("speed: 0 must be > 0"));
  EXPECT_THAT(error.message, testing::HasSubstr("speed: -2 must be > 0"));
}

TEST_F(BrokenRobot, AHandWhoseFingersOpenWhereItPointsIsRefused) {
  Replace("sketch.yaml", "opening: [1, 0, 0]", "opening: [0, 0, -2]");
  EXPECT_THAT(Load().message, testing::HasSubstr("approach (0, 0, 1) and opening (0, 0, -2) must be apart"));
  Replace("sketch.yaml", "opening: [0, 0, -2]", "opening: [0, 0, 0]");
  EXPECT_THAT(Load().message, testing::HasSubstr("opening (0, 0, 0) must be apart"));
}

TEST_F(BrokenRobot, DegreesAndGroupsOfNothingAreRefused) {
  Replace("sketch.yaml", "approach_pitch: 1.5708", "approach_pitch: 90");
  Replace("sketch.yaml", "yaw: 0 ", "yaw: 180 ");
  Replace("sketch.yaml", "[[left], [right]]", "[[left], []]");
  const Error error = Load();
  EXPECT_THAT(error.message, testing::HasSubstr("approach_pitch: 90: rad"));
  EXPECT_THAT(error.message, testing::HasSubstr("base.yaw: 180: rad"));
  EXPECT_THAT(error.message, testing::HasSubstr("a group without bodies"));
}

TEST_F(BrokenRobot, AMissingMeshIsMuJoCosMessage) {
  std::filesystem::remove(folder_ / "sketch/meshes/beam.obj");
  EXPECT_THAT(Load().message, testing::HasSubstr("beam.obj"));
}

TEST_F(BrokenRobot, ShapesThatNobodyKnowsDoNotCollide) {
  Replace("sketch/sketch.xml", "<geom type=\"capsule\" size=\"0.034 0.03\"",
          "<geom type=\"ellipsoid\" size=\"0.03 0.03 0.05\"");
  EXPECT_THAT(Load().message, testing::HasSubstr("collides as neither box"));
}

// MuJoCo couples what joints are away from their references; where the checker has a finger must be where it goes.
TEST_F(BrokenRobot, ACoupledFingerFollowsFromItsReference) {
  Replace("sketch/sketch.xml", "joint name=\"right_slide\"", "joint ref=\"0.01\" range=\"0 0.1\" name=\"right_slide\"");
  SceneSpec spec;
  spec.robot = (folder_ / "sketch.yaml").string();
  const auto scene = Scene::Build(spec);
  ASSERT_TRUE(scene) << scene.error().message;
  const auto& model = (*scene)->model();
  ASSERT_EQ(model.coupled_q.size(), 1u);
  EXPECT_NEAR(model.coupled_q[0].offset, 0.01, 1e-9);
  World world(*scene);
  const Pose home = world.X_WE();
  for (const double gripper : {0.0, 1.0}) {
    for (int i = 0; i < 100; ++i) world.Step({home, gripper}, Vector6d::Zero());
    const mjtNum* q = world.state().mj->qpos;
    const auto& [address, factor, offset] = model.coupled_q[0];
    EXPECT_NEAR(q[address], offset + factor * q[model.gripper_q[0]], 2e-3) << gripper;
  }
}

// A coupling within the finger is none with the other: before, the finger hung loose and every grasp failed.
TEST_F(BrokenRobot, AFingerThatTheFileCouplesToItsOwnTipFollowsTheOther) {
  Replace("sketch/sketch.xml", "<joint name=\"right_slide\" axis=\"-1 0 0\"/>",
          "<joint name=\"right_slide\" axis=\"-1 0 0\"/><body name=\"right_tip\"><joint name=\"right_tip\" axis=\"-1 0 "
          "0\"/>"
          "<geom class=\"look\" type=\"sphere\" size=\"0.004\" mass=\"0.01\"/></body>");
  Replace("sketch/sketch.xml", "joint1=\"right_slide\" joint2=\"left_slide\"",
          "joint1=\"right_tip\" joint2=\"right_slide\"");
  const auto scene = Build();
  ASSERT_TRUE(scene) << scene.error().message;
  const auto& model = (*scene)->model();
  ASSERT_EQ(model.coupled_q.size(), 1u);
  World world(*scene);
  const Pose home = world.X_WE();
  for (int i = 0; i < 100; ++i) world.Step({home, 1}, Vector6d::Zero());
  const mjtNum* q = world.state().mj->qpos;
  const auto& [address, factor, offset] = model.coupled_q[0];
  EXPECT_NEAR(q[address], offset + factor * q[model.gripper_q[0]], 2e-3);
}

// As of MJCF that was compiled from a URDF: the base is fused into the world, and the first link's frame is turned
// over.
TEST_F(BrokenRobot, ARootThatIsNotUprightKeepsItsTurn) {
  Replace("sketch/sketch.xml", "<body name=\"foot\">", "<body name=\"foot\" quat=\"0 1 0 0\">");
  const auto scene = Build();
  ASSERT_TRUE(scene) << scene.error().message;
  Kinematics kinematics(*scene);
  const Pose foot = kinematics.BodyPoses((*scene)->arm().q_home, 0, {"foot"}).front();
  EXPECT_LT((foot.q * Eigen::Vector3d::UnitZ() + Eigen::Vector3d::UnitZ()).norm(), 1e-9);
}

// A file that includes another may say of a kind of element what that one says more of.
TEST_F(BrokenRobot, SeveralSectionsOfDefaultsAreOne) {
  Replace("sketch/sketch.xml", "<include file=\"assets.xml\"/>",
          "<include file=\"assets.xml\"/><default><joint frictionloss=\"0.3\" armature=\"0.7\"/></default>");
  const auto scene = Build();
  ASSERT_TRUE(scene) << scene.error().message;
  const mjModel* mj = (*scene)->model().mj.get();
  const int lift = mj->jnt_dofadr[mj_name2id(mj, mjOBJ_JOINT, "lift")];
  EXPECT_EQ(mj->dof_frictionloss[lift], 0.3);
  EXPECT_EQ(mj->dof_armature[lift], 0.05) << "the later counts";
  EXPECT_EQ(mj->dof_damping[lift], 1);
}

// A body called like an object, a geom called like the table, a joint called like an object's.
TEST_F(BrokenRobot, NamesOfOursDoNotClash) {
  Replace("sketch/sketch.xml", "<body name=\"hand\"", "<body name=\"coke\"");
  Replace("sketch/sketch.xml", "<body name=\"left\"", "<body name=\"cube\"");
  Replace("sketch/sketch.xml", "<geom type=\"capsule\" size=\"0.034 0.03\"",
          "<geom name=\"table\" type=\"capsule\" size=\"0.034 0.03\"");
  Replace("sketch/sketch.xml", "joint name=\"right_slide\"", "joint name=\"milk\"");
  Replace("sketch/sketch.xml", "joint1=\"right_slide\"", "joint1=\"milk\"");
  Replace("sketch.yaml", "right_slide", "milk");
  Replace("sketch.yaml", "[left]", "[cube]");
  SceneSpec spec;
  spec.robot = (folder_ / "sketch.yaml").string();
  const auto scene = Scene::Build(spec);
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_EQ((*scene)->arm().finger_groups[0][0], "user_cube");
  World world(*scene);
  EXPECT_GT(world.ObjectPose("cube").p.y(), 0.2) << "the object, not the finger";
  const Pose home = world.X_WE();
  for (int i = 0; i < 100; ++i) world.Step({home, 1}, Vector6d::Zero());
  EXPECT_NEAR((*scene)->model().coupled_q.size(), 1, 0);
  EXPECT_NEAR(world.state().mj->qpos[(*scene)->model().coupled_q[0].address], 0, 2e-3) << "the coupled finger closes";

  spec.objects = {"pepsi"};
  const auto other = Scene::Build(spec);
  ASSERT_TRUE(other) << other.error().message;
  EXPECT_EQ((*other)->arm().finger_groups[0][0], "cube") << "nothing of that name stands there";
}

// franka_sim's Panda has such a class; mj_saveLastXML throws on it.
TEST_F(BrokenRobot, AMasslessMeshClassIsRead) {
  Replace("sketch/sketch.xml", "<geom contype=\"0\" conaffinity=\"0\" material=\"metal\" mass=\"0\"/>",
          "<geom type=\"mesh\" contype=\"0\" conaffinity=\"0\" material=\"metal\" mass=\"0\"/>");
  const auto loaded = LoadRobot(folder_ / "sketch.yaml");
  EXPECT_TRUE(loaded) << loaded.error().message;
}

// MuJoCo calls the class at the top "main" only where the file gives it no name.
TEST_F(BrokenRobot, TheClassAtTheTopMayHaveAName) {
  Replace("sketch/sketch.xml", "<default>\n    <geom material", "<default class=\"makers\">\n    <geom material");
  const auto scene = Build();
  ASSERT_TRUE(scene) << scene.error().message;
  const mjModel *named = (*scene)->model().mj.get(), *unnamed = SceneOf(kSketch)->model().mj.get();
  const int a = mj_name2id(named, mjOBJ_JOINT, "lift"), b = mj_name2id(unnamed, mjOBJ_JOINT, "lift");
  EXPECT_EQ(named->dof_damping[named->jnt_dofadr[a]], unnamed->dof_damping[unnamed->jnt_dofadr[b]]);
}

// A campaign's `world.friction` changes what stands in the elements.
TEST_F(BrokenRobot, FrictionChangesWithTheWorldWhereverItComesFrom) {
  const auto sliding = [&](double factor) {
    const auto scene = Build(factor);
    EXPECT_TRUE(scene) << scene.error().message;
    const mjModel* mj = (*scene)->model().mj.get();
    for (int i = 0; i < mj->ngeom; ++i)
      if (mj->geom_bodyid[i] == (*scene)->model().BodyId("left") && mj->geom_contype[i] != 0)
        return mj->geom_friction[3 * i];
    return 0.0;
  };
  EXPECT_DOUBLE_EQ(sliding(1), 0.9);
  EXPECT_DOUBLE_EQ(sliding(0.5), 0.45);
  Replace("sketch/sketch.xml", "friction=\"0.9 0.02 0.001\" ", "");
  EXPECT_DOUBLE_EQ(sliding(1), 1) << "MuJoCo's own";
  EXPECT_DOUBLE_EQ(sliding(0.5), 0.5);
}

TEST_F(BrokenRobot, AHandThatTouchesNothingIsRefused) {
  Replace("sketch/sketch.xml", "<geom type=\"box\" size=\"0.09 0.03 0.02\"",
          "<geom contype=\"0\" conaffinity=\"0\" type=\"box\" size=\"0.09 0.03 0.02\"");
  EXPECT_THAT(Load().message, testing::HasSubstr("no geom of the palm collides: neither of body 'hand'"));
  Replace("sketch/sketch.xml", "<geom friction=\"0.9 0.02 0.001\"",
          "<geom contype=\"0\" conaffinity=\"0\" friction=\"0.9 0.02 0.001\"");
  EXPECT_THAT(Load().message, testing::HasSubstr("gripper.fingers: no geom of theirs collides"));
}

// A scene of such a hand could not be measured: `etude robot check` ended in the middle.
TEST_F(BrokenRobot, AHandOfWhichNothingMovesIsRefused) {
  for (const char* slide : {"left_slide\" axis=\"1 0 0", "right_slide\" axis=\"-1 0 0"}) {
    // the joints go to an empty body beside the fingers, which stay
    const std::string joint = fmt::format("<joint name=\"{}\"/>", slide);
    Replace("sketch/sketch.xml", joint, "");
    Replace("sketch/sketch.xml", "<site name=\"grip\"",
            fmt::format("<body childclass=\"finger\">{}<geom class=\"look\" type=\"sphere\" size=\"0.01\" "
                        "mass=\"0.01\"/></body><site name=\"grip\"",
                        joint));
  }
  const Error error = Load();
  EXPECT_EQ(error.code, Code::kInvalidArgument);
  EXPECT_THAT(error.message, testing::HasSubstr((folder_ / "sketch.yaml").string()));
  EXPECT_THAT(error.message, testing::HasSubstr("nothing that collides of the hand's fingers (left, right) moves when "
                                                "joint 'left_slide' goes from open (0.04) to closed (0)"));
  EXPECT_THAT(error.message, testing::HasSubstr("name the joint that moves them"));
}

TEST_F(BrokenRobot, AGripperThatMovesTheWholeHandIsRefused) {
  Replace("sketch.yaml", "joint: left_slide", "joint: spin");
  const Error error = Load();
  EXPECT_EQ(error.code, Code::kInvalidArgument);
  EXPECT_THAT(error.message, testing::HasSubstr("gripper.joint: 'spin' moves body 'hand', which carries the tool"));
}

TEST_F(BrokenRobot, CompilerSettingsArePutIntoTheElements) {
  // the same angles in another order, about fixed axes, and masses by the geoms' densities
  Replace("sketch/sketch.xml", "meshdir=\"meshes\"", "meshdir=\"meshes\" eulerseq=\"ZYX\" settotalmass=\"30\"");
  Replace("sketch/sketch.xml", "<body name=\"upper\" pos=\"0 0 0.22\">",
          "<body name=\"upper\" pos=\"0 0 0.22\" euler=\"30 20 10\">");
  char message[1000] = "";
  const ModelPtr original(mj_loadXML((folder_ / "sketch/sketch.xml").c_str(), nullptr, message, sizeof message));
  ASSERT_TRUE(original) << message;
  const auto scene = Build();
  ASSERT_TRUE(scene) << scene.error().message;
  const mjModel* ours = (*scene)->model().mj.get();
  for (const char* name : {"turret", "upper", "fore", "left"}) {
    const int a = mj_name2id(original.get(), mjOBJ_BODY, name), b = (*scene)->model().BodyId(name);
    EXPECT_NEAR(original->body_mass[a], ours->body_mass[b], 1e-9) << name;
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(original->body_inertia[3 * a + k], ours->body_inertia[3 * b + k], 1e-9);
    for (int k = 0; k < 4; ++k) EXPECT_NEAR(original->body_quat[4 * a + k], ours->body_quat[4 * b + k], 1e-12) << name;
  }
}

TEST_F(BrokenRobot, RotorsAndFrictionMayStandInTheYaml) {
  Replace("sketch.yaml", "base:\n", "armature: [0.3, 0.3, 0.3, 0.1, 0.1, 0.1]\ndamping: [2, 2, 2, 1, 1, 0]\nbase:\n");
  const auto scene = Build();
  ASSERT_TRUE(scene) << scene.error().message;
  const mjModel* mj = (*scene)->model().mj.get();
  EXPECT_EQ(mj->dof_armature[(*scene)->model().arm_v[0]], 0.3);
  EXPECT_EQ(mj->dof_damping[(*scene)->model().arm_v[5]], 0);
  Replace("sketch.yaml", "damping: [2, 2, 2, 1, 1, 0]", "damping: [2, 2]");
  EXPECT_THAT(Load().message, testing::HasSubstr("damping: 2 for 6 joints"));
}

/// The sketch cut at its wrist into an arm and a gripper that have names in common.
class TwoFiles : public BrokenRobot {
 protected:
  TwoFiles() {
    const std::string whole = *ReadTextFile(folder_ / "sketch/sketch.xml");
    const std::size_t begin = whole.find("<body name=\"left\""),
                      end = whole.find("</body>", whole.find("\"right\"")) + 7;
    const std::string fingers = whole.substr(begin, end - begin);
    std::string arm = whole;
    arm.replace(begin, end - begin, "<site name=\"flange\" pos=\"0 0 0.04\" euler=\"0 0 90\"/>");
    const auto cut = [&](const std::string& from, const std::string& to) {
      const std::size_t at = arm.find(from);
      arm.erase(at, arm.find(to, at) + to.size() - at);
    };
    cut("<equality>", "</equality>");
    cut("<position joint=\"left_slide\"", "/>");
    EXPECT_TRUE(WriteFileAtomically(folder_ / "sketch/sketch.xml", arm));
    std::string text = fingers;
    for (std::size_t at; (at = text.find("pos=\"0 0 0.04\"")) != std::string::npos;) text.erase(at, 14);
    text =
        "<mujoco><compiler angle=\"radian\" meshdir=\"meshes\" autolimits=\"true\"/><include file=\"assets.xml\"/>"
        "<default><default class=\"finger\"><joint type=\"slide\" armature=\"0.1\" damping=\"400\" range=\"0 0.04\" "
        "solreflimit=\"0.004 1\"/><geom friction=\"0.9 0.02 0.001\" condim=\"4\" material=\"rubber\"/></default>"
        "<default class=\"look\"><geom contype=\"0\" conaffinity=\"0\" mass=\"0\"/></default></default>"
        "<worldbody><body name=\"foot\"><geom name=\"palm\" type=\"box\" size=\"0.01 0.01 0.01\" mass=\"0.1\"/>"
        "<site name=\"pinch\" pos=\"0 0 0.06\"/>" +
        text + "</body></worldbody></mujoco>";
    EXPECT_TRUE(WriteFileAtomically(folder_ / "sketch/gripper.xml", text));
    Replace("sketch.yaml", "gripper:\n", "gripper:\n  mjcf: sketch/gripper.xml\n  attach: flange\n");
    Replace("sketch.yaml", "site: grip ", "site: pinch ");
  }
};

TEST_F(TwoFiles, AnArmAndAGripperAreOneRobot) {
  const auto scene = Build();
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_THAT((*scene)->arm().bodies, testing::Contains("gripper_foot")) << "the arm's base has that name";
  World world(*scene);
  const Pose X_EP = SceneOf(kSketch)->arm().tool_site.empty() ? Pose{} : World(SceneOf(kSketch)).X_WE();
  EXPECT_LT((world.X_WE().p - X_EP.p).norm(), 1e-9) << "the pinch is where the grip was";
  const Pose home = world.X_WE();
  for (int i = 0; i < 100; ++i) world.Step({home, 1}, Vector6d::Zero());
  EXPECT_NEAR(world.gripper_q()[0], 0, 2e-3) << "it closes";
  const auto again = LoadRobot(folder_ / "sketch.yaml");
  EXPECT_EQ(again->model.finger_groups[1][0], "right");
}

// joint_1 of the arm and joint_1 of the gripper, as their makers number them.
TEST_F(TwoFiles, AJointThatBothHaveIsTheArmsAmongJoints) {
  Replace("sketch/gripper.xml", "\"left_slide\"", "\"turn\"");
  Replace("sketch.yaml", "joint: left_slide", "joint: turn");
  const auto loaded = LoadRobot(folder_ / "sketch.yaml");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(loaded->model.joints.at(0), "turn");
  EXPECT_THAT(loaded->model.gripper_joints, testing::ElementsAre("gripper_turn"));
  EXPECT_THAT(loaded->model.actuator,
              testing::HasSubstr("<motor name=\"turn\" joint=\"turn\" ctrlrange=\"-120 120\"/>"));
  EXPECT_THAT(loaded->model.actuator, testing::HasSubstr("joint=\"gripper_turn\" ctrlrange=\"-75"));
}

TEST_F(TwoFiles, AnArmMayHaveABodyOfTheMountsName) {
  Replace("sketch/sketch.xml", "<body name=\"hand\"", "<body name=\"gripper_mount\"");
  const auto scene = Build();
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_THAT((*scene)->arm().bodies, testing::Contains("gripper_mount"));
}

TEST_F(TwoFiles, AFlangeThatIsNotThereIsNamed) {
  Replace("sketch.yaml", "attach: flange", "attach: flansch");
  EXPECT_THAT(Load().message, testing::HasSubstr("no body or site 'flansch'"));
}

TEST_F(BrokenRobot, AToolOfTheWorldIsRefused) {
  Replace("sketch.yaml", "site: grip", "body: world");
  EXPECT_THAT(Load().message, testing::HasSubstr("tool: body 'world' is none of the robot's"));
}

// MuJoCo takes "" for no name, and its later releases carry a link's weight where a file says so
TEST_F(BrokenRobot, EmptyNamesAndCarriedWeightsAreRead) {
  Replace("sketch/sketch.xml", "<geom type=\"cylinder\" size=\"0.065 0.08\"",
          "<geom name=\"\" type=\"cylinder\" size=\"0.065 0.08\"");
  Replace("sketch/sketch.xml", "<body name=\"upper\"", "<body name=\"upper\" gravcomp=\"1\"");
  const auto scene = Build();
  ASSERT_TRUE(scene) << scene.error().message;
}

TEST_F(BrokenRobot, LaterMujocosWordsAreNamed) {
  Replace("sketch/sketch.xml", "<site name=\"grip\" pos=\"0 0 0.10\"/>",
          "<frame pos=\"0 0 0.1\"><site name=\"grip\"/></frame>");
  EXPECT_THAT(Load().message, testing::HasSubstr("<frame> belongs to a later MuJoCo"));
}

TEST_F(BrokenRobot, LaterMujocosLimitsAreTaken) {
  Replace("sketch/sketch.xml", "<joint name=\"turn\" axis=\"0 0 1\"",
          "<joint name=\"turn\" axis=\"0 0 1\" actuatorfrcrange=\"-44 44\"");
  const auto loaded = LoadRobot(folder_ / "sketch.yaml");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_THAT(loaded->model.actuator, testing::HasSubstr("joint=\"turn\" ctrlrange=\"-44 44\""));
}

TEST_F(BrokenRobot, APointerOfGitLfsIsNoMesh) {
  ASSERT_TRUE(WriteFileAtomically(folder_ / "sketch/meshes/beam.obj",
                                  std::string("version https://git-lfs.github.com/spec/v1\noid sha256:12\n")));
  EXPECT_THAT(Load().message, testing::HasSubstr("git lfs pull"));
}

TEST_F(BrokenRobot, FilesThatIncludeThemselvesEnd) {
  Replace("sketch/assets.xml", "<asset>", "<include file=\"assets.xml\"/><asset>");
  EXPECT_THAT(Load().message, testing::HasSubstr("includes go more than"));
}

TEST_F(BrokenRobot, AFileThatChangesIsReadAgain) {
  ASSERT_TRUE(LoadRobot(folder_ / "sketch.yaml"));
  Replace("sketch/sketch.xml", "forcerange=\"-150 150\"", "forcerange=\"-155 155\"");
  EXPECT_THAT(LoadRobot(folder_ / "sketch.yaml")->model.actuator, testing::HasSubstr("-155 155"));
}

// What real descriptions have besides: a base that floats, fingers pulled by a tendon, a texture, a keyframe.
TEST_F(BrokenRobot, IsNotBrokenByWhatItsMakersLike) {
  Replace("sketch/sketch.xml", "<geom type=\"mesh\" mesh=\"foot\" mass=\"5\"/>",
          "<freejoint name=\"float\"/><geom type=\"mesh\" mesh=\"foot\" mass=\"5\"/>");
  Replace("sketch/sketch.xml", "<position joint=\"left_slide\" kp=\"500\" forcerange=\"-60 60\"/>",
          "<position tendon=\"pull\" kp=\"500\" forcerange=\"-60 60\"/>");
  Replace("sketch/sketch.xml", "<actuator>",
          "<tendon><fixed name=\"pull\"><joint joint=\"left_slide\" coef=\"0.5\"/><joint joint=\"right_slide\" "
          "coef=\"0.5\"/></fixed></tendon>\n<sensor><jointpos joint=\"turn\"/></sensor>\n<actuator>");
  Replace("sketch/assets.xml", "<material name=\"metal\"",
          "<texture name=\"wood\" type=\"2d\" builtin=\"checker\" rgb1=\"1 0 0\" width=\"16\" height=\"16\"/>"
          "<material name=\"metal\" texture=\"wood\"");
  const auto loaded = LoadRobot(folder_ / "sketch.yaml");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_THAT(loaded->notes, testing::Contains(testing::HasSubstr("stands still")));
  EXPECT_THAT(loaded->model.tendon, testing::HasSubstr("pull"));
  const auto scene = Build();
  ASSERT_TRUE(scene) << scene.error().message;
  World world(*scene);
  const Pose home = world.X_WE();
  for (int i = 0; i < 100; ++i) world.Step({home, 1}, Vector6d::Zero());
  EXPECT_NEAR(world.gripper_q()[0], 0, 2e-3) << "it closes";
  EXPECT_LT((world.X_WE().p - home.p).norm(), 1e-3);
  EXPECT_TRUE(world.healthy());
}

// it was left out as one that nothing has, and MuJoCo refused the tendon
TEST_F(BrokenRobot, ATendonMayHaveAMaterialOfItsOwn) {
  Replace("sketch/sketch.xml", "<geom type=\"mesh\" mesh=\"fore_beam\" mass=\"1.5\"/>",
          "<geom type=\"mesh\" mesh=\"fore_beam\" mass=\"1.5\"/><site name=\"knot\"/>");
  Replace("sketch/sketch.xml", "<actuator>",
          "<tendon><spatial name=\"cord\" material=\"hemp\"><site site=\"knot\"/><site site=\"grip\"/></spatial>"
          "</tendon>\n<actuator>");
  Replace("sketch/assets.xml", "<material name=\"metal\"",
          "<material name=\"hemp\" rgba=\"0.7 0.6 0.4 1\"/><material name=\"metal\"");
  const auto scene = Build();
  ASSERT_TRUE(scene) << scene.error().message;
  const mjModel* mj = (*scene)->model().mj.get();
  ASSERT_EQ(mj->ntendon, 1);
  EXPECT_STREQ(mj_id2name(mj, mjOBJ_MATERIAL, mj->tendon_matid[0]), "user_hemp");
}

TEST_F(BrokenRobot, TurnsObjectsTowardsLevelUnlessToldOtherwise) {
  constexpr double kPi = 3.14159265358979;
  EXPECT_NEAR(LoadRobot(folder_ / "sketch.yaml")->model.turned_pitch, 0, 1e-3);
  Replace("sketch.yaml", "approach_pitch:", "turn: 1.5708\napproach_pitch:");
  EXPECT_NEAR(LoadRobot(folder_ / "sketch.yaml")->model.turned_pitch, kPi, 1e-3);
  Replace("sketch.yaml", "turn: 1.5708\n", "turn: 1\n");
  EXPECT_THAT(Load().message, testing::HasSubstr("turn: 1"));
}

// the stages of a level hand know no other way: what the file said was accepted and not done
TEST_F(BrokenRobot, ALevelHandTurnsObjectsOverByPointingDown) {
  Replace("sketch.yaml", "approach_pitch: 1.5708", "turn: -1.5708\napproach_pitch: 0");
  EXPECT_THAT(Load().message, testing::HasSubstr("turn: -1.5708: a level hand turns an object over by pointing down"));
  Replace("sketch.yaml", "turn: -1.5708\n", "turn: 1.5708\n");
  EXPECT_TRUE(LoadRobot(folder_ / "sketch.yaml"));
  Replace("sketch.yaml", "approach_pitch: 0", "approach_pitch: -0.3");
  EXPECT_THAT(Load().message, testing::HasSubstr("approach_pitch: -0.3: 0 (level) or more"));
}

// Half of the torque is left for everything else; what the judge allows stays what the maker says.
TEST_F(BrokenRobot, DampingSlowsWhatIsPlanned) {
  Replace("sketch.yaml", "base:\n", "damping: [1, 1, 1, 1, 1, 30]\nbase:\n");
  const auto loaded = LoadRobot(folder_ / "sketch.yaml");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(loaded->model.joint_speed[5], 3);
  EXPECT_DOUBLE_EQ(loaded->model.planned_speed[5], 0.5);
  EXPECT_EQ(loaded->model.planned_speed[0], 2.5);
  EXPECT_THAT(loaded->notes, testing::Contains(testing::HasSubstr("'spin' is planned for 0.50 rad/s at most")));
}

// A parallelogram of which one joint is driven: the second crank stands parallel, the bar on the first stays level.
TEST_F(BrokenRobot, JointsOfAClosedChainAreFoundByClosingIt) {
  Replace("sketch/sketch.xml", "<body name=\"left\"",
          "<body name=\"crank\" pos=\"0 0.1 0\"><joint name=\"crank\" axis=\"0 1 0\" range=\"0 60\"/>"
          "<geom class=\"look\" type=\"box\" size=\"0.004 0.004 0.02\" pos=\"0 0 0.02\" mass=\"0.02\"/>"
          "<body name=\"bar\" pos=\"0 0 0.04\"><joint name=\"bar\" axis=\"0 1 0\"/>"
          "<geom class=\"look\" type=\"box\" size=\"0.02 0.004 0.004\" pos=\"0.02 0 0\" mass=\"0.02\"/></body></body>"
          "<body name=\"rocker\" pos=\"0.04 0.1 0\"><joint name=\"rocker\" axis=\"0 1 0\"/>"
          "<geom class=\"look\" type=\"box\" size=\"0.004 0.004 0.02\" pos=\"0 0 0.02\" mass=\"0.02\"/></body>"
          "<body name=\"left\"");
  Replace("sketch/sketch.xml", "<equality>",
          "<equality><connect body1=\"bar\" body2=\"rocker\" anchor=\"0.04 0 0\" solref=\"0.004 1\"/>"
          "<joint joint1=\"crank\" joint2=\"left_slide\" polycoef=\"0.8 -20 0 0 0\"/>");
  const auto loaded = LoadRobot(folder_ / "sketch.yaml");
  ASSERT_TRUE(loaded) << loaded.error().message;
  std::map<std::string, assets::RobotModel::Coupled> found;
  for (const auto& coupled : loaded->model.coupled_joints) found[coupled.joint] = coupled;
  ASSERT_TRUE(found.contains("crank") && found.contains("bar") && found.contains("rocker"));
  EXPECT_NEAR(found["crank"].factor, -20, 0.5);
  EXPECT_NEAR(found["crank"].offset, 0.8, 0.02);
  EXPECT_NEAR(found["rocker"].factor, -20, 0.5);
  EXPECT_NEAR(found["bar"].factor, 20, 0.5);
  EXPECT_THAT(loaded->notes, testing::Contains(testing::HasSubstr("found by closing the gripper")));
}

// MuJoCo looks at the faces of a mesh that weighs something, and CAD's are often of two sides.
TEST_F(BrokenRobot, MasslessLooksMayHaveFacesOfTwoSides) {
  const Path mesh = folder_ / "sketch/meshes/looks.obj";
  ASSERT_TRUE(WriteFileAtomically(
      mesh, std::string_view(ReadTextFile(folder_ / "sketch/meshes/foot.obj").value() + "\nf 1 2 10 9\n")));
  Replace("sketch/assets.xml", "<asset>", "<asset><mesh name=\"looks\" file=\"looks.obj\"/>");
  Replace("sketch/sketch.xml", "<geom type=\"mesh\" mesh=\"upper_beam\" mass=\"4\"/>",
          "<geom type=\"mesh\" mesh=\"upper_beam\" mass=\"4\"/><geom class=\"look\" type=\"mesh\" mesh=\"looks\"/>");
  const auto loaded = LoadRobot(folder_ / "sketch.yaml");
  ASSERT_TRUE(loaded) << loaded.error().message;
  const auto visuals = WeighVisuals(folder_ / "sketch.yaml");
  EXPECT_TRUE(visuals) << visuals.error().message;
  Replace("sketch.yaml", "name: sketch\n", "name: sketch\nmasses: collision\n");
  const auto scene = Build();
  EXPECT_TRUE(scene) << scene.error().message;
}

/// Its looks, which weigh nothing in the example, have MuJoCo's default density of 1000 kg/m^3.
class HeavyLooks : public BrokenRobot {
 protected:
  HeavyLooks() {
    EXPECT_THAT(Names(), testing::IsEmpty()) << "the example is in order";
    Replace("sketch/sketch.xml", "<geom contype=\"0\" conaffinity=\"0\" material=\"metal\" mass=\"0\"/>",
            "<geom contype=\"0\" conaffinity=\"0\" material=\"metal\"/>");
  }
  std::vector<VisualMass> Visuals() const {
    const auto visuals = WeighVisuals(folder_ / "sketch.yaml");
    EXPECT_TRUE(visuals) << visuals.error().message;
    return visuals.value_or(std::vector<VisualMass>{});
  }
  std::vector<std::string> Names() const {
    std::vector<std::string> names;
    for (const VisualMass& visual : Visuals()) names.push_back(visual.body);
    return names;
  }
};

TEST_F(HeavyLooks, AreWeighedBesideWhatCollides) {
  constexpr double kPi = 3.14159265358979, kDensity = 1000;
  const auto cylinder = [&](double radius, double half) { return kDensity * kPi * radius * radius * 2 * half; };
  EXPECT_THAT(Names(), testing::ElementsAre("upper", "turret", "left", "right")) << "heaviest first";
  const auto visuals = Visuals();
  ASSERT_EQ(visuals.size(), 4u);
  EXPECT_NEAR(visuals[0].mass, cylinder(0.055, 0.062), 1e-5);
  EXPECT_NEAR(visuals[1].mass, cylinder(0.045, 0.082), 1e-5);
  EXPECT_NEAR(visuals[2].mass, kDensity * 8 * 0.006 * 0.011 * 0.014, 1e-5);
}

TEST_F(HeavyLooks, WeighOnceWhereTheLinksMassIsGiven) {
  Replace("sketch/sketch.xml", "<joint name=\"lift\" axis=\"-1 0 0\" range=\"-100 120\"/>",
          "<joint name=\"lift\" axis=\"-1 0 0\" range=\"-100 120\"/>"
          "<inertial pos=\"0 0 0.2\" mass=\"4\" diaginertia=\"0.06 0.06 0.01\"/>");
  EXPECT_THAT(Names(), testing::ElementsAre("turret", "left", "right"));
}

TEST_F(HeavyLooks, WeighOnceWhereNothingElseDoes) {
  Replace("sketch/sketch.xml", "<geom type=\"mesh\" mesh=\"upper_beam\" mass=\"4\"/>",
          "<geom type=\"mesh\" mesh=\"upper_beam\" mass=\"0\"/>");
  EXPECT_THAT(Names(), testing::ElementsAre("turret", "left", "right"));
}

TEST_F(HeavyLooks, WeighOnceWhereTheirGroupOrTheTotalIsASetting) {
  Replace("sketch/sketch.xml", "meshdir=\"meshes\"", "meshdir=\"meshes\" settotalmass=\"30\"");
  EXPECT_THAT(Names(), testing::IsEmpty());
  Replace("sketch/sketch.xml", "settotalmass=\"30\"", "inertiagrouprange=\"0 1\"");
  EXPECT_THAT(Names(), testing::SizeIs(4)) << "their group is 0, as that of all";
  Replace("sketch/sketch.xml", "conaffinity=\"0\" material=\"metal\"",
          "conaffinity=\"0\" group=\"2\" material=\"metal\"");
  EXPECT_THAT(Names(), testing::IsEmpty());
}

TEST_F(HeavyLooks, OfTheBaseDoNotMatter) {
  Replace("sketch/sketch.xml", "<geom type=\"mesh\" mesh=\"foot\" mass=\"5\"/>",
          "<geom type=\"mesh\" mesh=\"foot\" mass=\"5\"/><geom class=\"look\" type=\"mesh\" mesh=\"foot\"/>");
  EXPECT_THAT(Names(), testing::Not(testing::Contains("foot")));
  EXPECT_THAT(Names(), testing::SizeIs(4));
}

TEST_F(HeavyLooks, WeighNothingWhereTheYamlSaysSo) {
  const auto weight = [&](const std::string& robot) {
    SceneSpec spec;
    spec.robot = robot;
    const auto scene = Scene::Build(spec);
    EXPECT_TRUE(scene) << scene.error().message;
    return scene ? WeighRobot(**scene).total : 0;
  };
  const double light = weight(kSketch);
  EXPECT_GT(weight((folder_ / "sketch.yaml").string()), light + 1);
  Replace("sketch.yaml", "name: sketch\n", "name: sketch\nmasses: collision\n");
  EXPECT_NEAR(weight((folder_ / "sketch.yaml").string()), light, 1e-4);
  EXPECT_THAT(Names(), testing::IsEmpty());
}

TEST_F(HeavyLooks, WeighWhereNothingElseDoes) {
  Replace("sketch/sketch.xml", "<geom type=\"mesh\" mesh=\"upper_beam\" mass=\"4\"/>",
          "<geom type=\"mesh\" mesh=\"upper_beam\" mass=\"0\"/>");
  Replace("sketch.yaml", "name: sketch\n", "name: sketch\nmasses: collision\n");
  const auto scene = Build();
  ASSERT_TRUE(scene) << scene.error().message;
  const mjModel* mj = (*scene)->model().mj.get();
  EXPECT_GT(mj->body_mass[(*scene)->model().BodyId("upper")], 0.5) << "it would weigh nothing";
}

// What two fingers hold by points alone swings about the line between them.
TEST_F(BrokenRobot, FingersThatDecideAloneHoldByAnArea) {
  const auto geoms = [&] {
    const auto scene = Build();
    EXPECT_TRUE(scene) << scene.error().message;
    std::vector<std::pair<int, std::vector<double>>> found;  // condim, friction
    if (!scene) return found;
    const mjModel* mj = (*scene)->model().mj.get();
    for (int i = 0; i < mj->ngeom; ++i)
      if (mj->geom_bodyid[i] == (*scene)->model().BodyId("left") && mj->geom_contype[i] != 0)
        found.push_back({mj->geom_condim[i], {mj->geom_friction + 3 * i, mj->geom_friction + 3 * i + 3}});
    EXPECT_FALSE(found.empty());
    return found;
  };
  Replace("sketch/sketch.xml", "friction=\"0.9 0.02 0.001\" condim=\"4\"", "friction=\"0.7\" condim=\"3\"");
  for (const auto& [condim, friction] : geoms()) EXPECT_EQ(condim, 3) << "the object's friction counts, too";
  Replace("sketch/sketch.xml", "friction=\"0.7\" condim=\"3\"", "friction=\"0.7\" condim=\"3\" priority=\"1\"");
  for (const auto& [condim, friction] : geoms()) {
    EXPECT_EQ(condim, 4);
    EXPECT_THAT(friction, testing::ElementsAre(0.7, 0.02, testing::Lt(0.01)));
  }
  EXPECT_THAT(LoadRobot(folder_ / "sketch.yaml")->notes,
              testing::Contains(testing::HasSubstr("friction against turning as our objects have")));
  Replace("sketch/sketch.xml", "condim=\"3\" priority=\"1\"", "condim=\"1\" priority=\"1\"");
  for (const auto& [condim, friction] : geoms()) EXPECT_EQ(condim, 1) << "without any friction on purpose";
}

// planner and judge took the upper arm for air, and the check found nothing to say
TEST_F(BrokenRobot, BodiesOfWhichNothingCollidesAreSaid) {
  Replace("sketch/sketch.xml", "mesh=\"upper_beam\" mass=\"4\"/>",
          "mesh=\"upper_beam\" mass=\"4\" contype=\"0\" conaffinity=\"0\"/>");
  const auto loaded = LoadRobot(folder_ / "sketch.yaml");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_THAT(loaded->notes, testing::Contains(testing::HasSubstr("of upper no geom collides")));
}

TEST_F(BrokenRobot, ARobotThatNoPictureShowsIsRefused) {
  Replace("sketch/sketch.xml", "<geom material=\"paint\"/>", "<geom material=\"paint\" group=\"3\"/>");
  EXPECT_THAT(Load().message, testing::HasSubstr("no geom of the robot is drawn"));
}

TEST_F(BrokenRobot, UnknownKeysAreRefused) {
  Replace("sketch.yaml", "approach_pitch:", "aproach_pitch:");
  EXPECT_THAT(Load().message, testing::HasSubstr("approach_pitch"));
}

}  // namespace robot_file_test
}  // namespace etude::sim
