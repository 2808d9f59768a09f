// SPDX-License-Identifier: Apache-2.0
// Tests worker/sim/mjcf_document.cc and mjcf_normalise.cc; MuJoCo's own compiler is the reference.
#include "worker/sim/mjcf_document.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <mujoco/mujoco.h>

#include <cstdlib>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "worker/sim/model.h"

namespace etude::sim {
namespace mjcf_document_test {

using testing::DoubleNear;
using testing::ElementsAre;

class Document : public testing::Test {
 protected:
  Path Write(const std::string& name, const std::string& text) {
    EXPECT_THAT(WriteFileAtomically(folder_ / name, std::string_view(text)), IsOk());
    return folder_ / name;
  }
  Result<MjcfDocument> Try(const std::string& text) { return MjcfDocument::Read(Write("robot.xml", text)); }
  MjcfDocument Read(const std::string& text) {
    auto document = Try(text);
    if (!document) {
      ADD_FAILURE() << document.error().message << " in\n" << text;
      std::abort();
    }
    return std::move(*document);
  }
  /// What Read read last, compiled by MuJoCo.
  ModelPtr Compiled() {
    char message[1000] = "";
    ModelPtr model(mj_loadXML((folder_ / "robot.xml").c_str(), nullptr, message, sizeof message));
    EXPECT_NE(model, nullptr) << message;
    return model;
  }
  static const tinyxml2::XMLElement& Find(const MjcfDocument& document, const char* kind, const std::string& name) {
    for (const auto* element : Descendants(document.Section("worldbody"), kind))
      if (Attribute(*element, "name") == name) return *element;
    ADD_FAILURE() << kind << " " << name;
    std::abort();
  }

  TemporaryFolder folder_;
};

TEST_F(Document, OrientationsAreWhatMuJoCoMakesOfThem) {
  for (const auto& [unit, scale] : {std::pair{"degree", 57.29577951308232}, {"radian", 1.0}})
    for (const char* order : {"xyz", "XYZ", "ZYX", "zxz", "zYx"}) {
      std::string bodies;
      const auto add = [&](const char* name, const std::string& orientation) {
        bodies += fmt::format(R"(<body name="{}" pos="1 2 3" {}><geom size="0.1"/></body>)", name, orientation);
      };
      add("euler", fmt::format(R"(euler="{} {} {}")", 0.3 * scale, -0.7 * scale, 1.9 * scale));
      add("axisangle", fmt::format(R"(axisangle="1 -2 0.5 {}")", 2.2 * scale));
      add("xyaxes", R"(xyaxes="1 2 0.5 -1 1 3")");
      add("zaxis", R"(zaxis="1 -2 0.3")");
      add("quat", R"(quat="0.5 0.5 -0.5 0.5")");
      add("none", "");
      const MjcfDocument document = Read(fmt::format(
          R"(<mujoco><compiler angle="{}" eulerseq="{}"/><worldbody>{}</worldbody></mujoco>)", unit, order, bodies));
      const ModelPtr model = Compiled();
      for (const char* name : {"euler", "axisangle", "xyaxes", "zaxis", "quat", "none"}) {
        const mjtNum* q = model->body_quat + 4 * mj_name2id(model.get(), mjOBJ_BODY, name);
        const Pose pose = PoseOf(Find(document, "body", name));
        EXPECT_LT(AngleBetween(pose.q, Eigen::Quaterniond(q[0], q[1], q[2], q[3])), 1e-6)
            << name << " " << unit << " " << order;
        EXPECT_EQ(pose.p, Eigen::Vector3d(1, 2, 3));
      }
    }
}

TEST_F(Document, AnglesOfJointsAreRadiansAndSlidesStayMetres) {
  const MjcfDocument document = Read(R"(<mujoco><default><default class="wide"><joint range="-90 45"/></default>
      <default class="rail"><joint type="slide" range="-0.5 0.25"/></default></default><worldbody><body>
      <joint name="own" limited="true" range="-30 60" ref="10"/><geom size="0.1"/><body><joint name="classed"
      class="wide" limited="true"/><geom size="0.1"/><body><joint name="rail" class="rail" limited="true"/>
      <geom size="0.1"/></body></body></body></worldbody></mujoco>)");
  const ModelPtr model = Compiled();
  for (const char* name : {"own", "classed"}) {
    const mjtNum* range = model->jnt_range + 2 * mj_name2id(model.get(), mjOBJ_JOINT, name);
    EXPECT_THAT(NumbersOf(Attribute(Find(document, "joint", name), "range")),
                ElementsAre(DoubleNear(range[0], 1e-12), DoubleNear(range[1], 1e-12)))
        << name;
  }
  EXPECT_NEAR(NumbersOf(Attribute(Find(document, "joint", "own"), "ref")).at(0), 0.17453292519943295, 1e-12);
  EXPECT_EQ(document.Resolved(Find(document, "joint", "rail"), "range"), "-0.5 0.25");
}

TEST_F(Document, IncludesStandWhereTheyAreSaidAndSectionsAreOne) {
  Write("arm.xml", R"(<mujocoinclude><body name="arm"/><body name="hand"/></mujocoinclude>)");
  Write("assets.xml", R"(<mujoco><asset><material name="red"/></asset></mujoco>)");
  const MjcfDocument document = Read(R"(<mujoco><include file="assets.xml"/><compiler angle="degree" meshdir="a"/>
      <asset><material name="green"/></asset><compiler angle="radian"/>
      <worldbody><body name="base"><include file="arm.xml"/><body name="tool"/></body></worldbody></mujoco>)");
  std::vector<std::string> bodies, materials;
  for (const auto* body : Descendants(document.Section("worldbody"), "body"))
    bodies.push_back(Attribute(*body, "name"));
  for (const auto* item : Descendants(document.Section("asset"), "material"))
    materials.push_back(Attribute(*item, "name"));
  EXPECT_THAT(bodies, ElementsAre("base", "arm", "hand", "tool"));
  EXPECT_THAT(materials, ElementsAre("red", "green"));
  EXPECT_EQ(Attribute(*document.Section("compiler"), "angle"), "radian") << "the later of two settings";
  EXPECT_EQ(Attribute(*document.Section("compiler"), "meshdir"), "a");
  EXPECT_EQ(document.sources().size(), 3u);
}

TEST_F(Document, DefaultsAreThoseOfTheNearestClass) {
  const MjcfDocument document = Read(R"(<mujoco><compiler angle="radian"/><default><geom rgba="1 1 1 1" size="1"/>
      <default class="a"><geom size="2"/><default class="b"><geom size="3"/></default></default></default><worldbody>
      <geom name="main"/><geom name="own" size="9"/><body childclass="a"><geom name="child"/><geom name="classed"
      class="b"/><body><geom name="deeper"/></body></body></worldbody></mujoco>)");
  const auto size = [&](const char* name) { return document.Resolved(Find(document, "geom", name), "size"); };
  EXPECT_EQ(size("main"), "1");
  EXPECT_EQ(size("own"), "9");
  EXPECT_EQ(size("child"), "2");
  EXPECT_EQ(size("deeper"), "2") << "a childclass holds for all below";
  EXPECT_EQ(size("classed"), "3") << "a class of its own beats the body's";
  EXPECT_EQ(document.Resolved(Find(document, "geom", "classed"), "rgba"), "1 1 1 1") << "inherited from main";
  EXPECT_EQ(document.Resolved(Find(document, "geom", "classed"), "mass"), "");
}

TEST_F(Document, AnActuatorsLimitIsTheMostThatItGives) {
  const std::string joints = R"(<worldbody><body><joint name="j"/><joint name="capped" actuatorfrcrange="-7 7"/>
      </body></worldbody>)";
  const auto limit = [&](const std::string& actuators, const char* joint = "j") {
    return Read("<mujoco>" + joints + "<actuator>" + actuators + "</actuator></mujoco>").ActuatorLimit(joint);
  };
  EXPECT_EQ(limit(""), 0);
  EXPECT_EQ(limit(R"(<position joint="j" kp="10" forcerange="-40 30"/>)"), 40);
  EXPECT_EQ(limit(R"(<position joint="j" kp="10" ctrlrange="-3 3"/>)"), 0) << "an angle is no torque";
  EXPECT_EQ(limit(R"(<position joint="other" forcerange="-40 40"/>)"), 0);
  EXPECT_EQ(limit(R"(<position jointinparent="j" forcerange="-5 5"/>)"), 5);
  EXPECT_EQ(limit(R"(<motor joint="j" gear="50" ctrlrange="-2 2"/>)"), 100);
  EXPECT_EQ(limit(R"(<motor joint="j" gear=" " ctrlrange="-2 2"/>)"), 2) << "nothing was said";
  EXPECT_EQ(limit(R"(<motor joint="j" gear="50" ctrllimited="false" ctrlrange="-2 2"/>)"), 0);
  EXPECT_EQ(limit(R"(<general joint="j" gainprm="20" ctrlrange="-2 2"/>)"), 40);
  EXPECT_EQ(limit(R"(<general joint="j" biastype="affine" gainprm="20" ctrlrange="-2 2"/>)"), 0) << "a servo";
  EXPECT_EQ(limit(R"(<motor joint="j" ctrlrange="-2 2"/><motor joint="j" ctrlrange="-9 9"/>)"), 9);
  EXPECT_EQ(limit(R"(<motor joint="capped" ctrlrange="-20 20"/>)", "capped"), 7);
  EXPECT_EQ(limit(R"(<motor joint="capped" ctrlrange="-2 2"/>)", "capped"), 2);
  EXPECT_EQ(limit("", "capped"), 7) << "all that a file of a later MuJoCo may say";
}

TEST_F(Document, AnActuatorsDefaultsMayStandUnderAnotherOfItsKinds) {
  const MjcfDocument document = Read(R"(<mujoco><default><default class="big"><general forcerange="-87 87"/></default>
      </default><worldbody><body><joint name="j"/></body></worldbody><actuator><position class="big" joint="j"/>
      </actuator></mujoco>)");
  EXPECT_EQ(document.ActuatorLimit("j"), 87);
}

TEST_F(Document, AssetsAreWhereTheCompilerSays) {
  const auto path = [&](const std::string& compiler, const char* kind, const std::string& file) {
    const MjcfDocument document =
        Read("<mujoco><compiler " + compiler + "/><asset><" + kind + " name=\"x\"/></asset></mujoco>");
    const Path found = document.AssetPath(*document.Section("asset")->FirstChildElement(), file);
    return found.lexically_relative(folder_.path()).string();
  };
  EXPECT_EQ(path("", "mesh", "a.obj"), "a.obj");
  EXPECT_EQ(path(R"(meshdir="m" texturedir="t")", "mesh", "a.obj"), "m/a.obj");
  EXPECT_EQ(path(R"(meshdir="m" texturedir="t")", "texture", "a.png"), "t/a.png");
  EXPECT_EQ(path(R"(assetdir="d")", "mesh", "a.obj"), "d/a.obj");
  EXPECT_EQ(path(R"(assetdir="d")", "texture", "a.png"), "d/a.png");
  EXPECT_EQ(path(R"(assetdir="d" meshdir="m")", "mesh", "../a.obj"), "a.obj");
  EXPECT_EQ(path(R"(meshdir="m" strippath="true")", "mesh", "far/away/a.obj"), "m/a.obj");
  EXPECT_EQ(path(R"(meshdir="m" strippath="true")", "mesh", R"(C:\away\a.obj)"), "m/a.obj");
}

TEST_F(Document, OnlySettingsThatChangeMassesAreKept) {
  const auto settings = [&](const std::string& compiler) {
    return Read("<mujoco><compiler " + compiler + "/></mujoco>").mass_settings();
  };
  EXPECT_EQ(settings(R"(angle="radian" settotalmass="-1" inertiafromgeom="auto" boundmass="0")"), "");
  EXPECT_EQ(settings(R"(inertiagrouprange="3 4" angle="radian" boundmass="0.1")"),
            R"( boundmass="0.1" inertiagrouprange="3 4")");
}

TEST_F(Document, RefusesWhatIsNoRobotOfOurMuJoCoAndSaysWhy) {
  for (const auto& [text, says] : std::initializer_list<std::pair<const char*, const char*>>{
           {"<mujoco>", "is no XML"},
           {"", "is no XML"},
           {"<robot name=\"urdf\"/>", "its root is <robot>, not <mujoco>"},
           {R"(<mujoco><compiler coordinate="global"/></mujoco>)", "coordinate=\"global\""},
           {R"(<mujoco><compiler fitaabb="true"/></mujoco>)", "fitaabb=\"true\""},
           {R"(<mujoco><compiler eulerseq="xyw"/></mujoco>)", "eulerseq 'xyw' is not three of xyz"},
           {R"(<mujoco><compiler eulerseq="xy"/></mujoco>)", "eulerseq 'xy'"},
           {R"(<mujoco><worldbody><body euler="1 2"/></worldbody></mujoco>)", "euler=\"1 2\"> has 2 numbers, not 3"},
           {R"(<mujoco><worldbody><body axisangle="1 2 3"/></worldbody></mujoco>)", "has 3 numbers, not 4"},
           {R"(<mujoco><worldbody><replicate count="3"/></worldbody></mujoco>)", "<replicate> belongs to a later"},
           {R"(<mujoco><asset><model file="a.xml"/></asset></mujoco>)", "<model> belongs to a later"}}) {
    const auto document = Try(text);
    EXPECT_THAT(document, HasCode(Code::kInvalidArgument)) << text;
    EXPECT_THAT(document, MessageHas(says)) << text;
  }
  EXPECT_THAT(Try(R"(<mujoco><include file="none.xml"/></mujoco>)"), HasCode(Code::kNotFound));
  EXPECT_THAT(MjcfDocument::Read(folder_ / "none.xml"), HasCode(Code::kNotFound));
}

TEST_F(Document, AttributesOfLaterReleasesAreDroppedAndOthersAreNot) {
  MjcfDocument document = Read(R"(<mujoco><asset><mesh name="m" file="m.obj" maxhullvert="8" scale="2 2 2"/></asset>
      <worldbody><body><joint name="j" actuatorfrcrange="-7 7" damping="3"/></body></worldbody></mujoco>)");
  document.DropNewerAttributes();
  const auto& joint = Find(document, "joint", "j");
  EXPECT_EQ(Attribute(joint, "actuatorfrcrange"), "");
  EXPECT_EQ(Attribute(joint, "damping"), "3");
  const auto& mesh = *document.Section("asset")->FirstChildElement();
  EXPECT_EQ(Attribute(mesh, "maxhullvert"), "");
  EXPECT_EQ(Attribute(mesh, "scale"), "2 2 2");
}

TEST(Poses, AreReadAsTheyWereWritten) {
  tinyxml2::XMLDocument document;
  auto* element = document.NewElement("body");
  document.InsertEndChild(element);
  EXPECT_EQ(PoseOf(*element).p, Eigen::Vector3d::Zero());
  EXPECT_EQ(PoseOf(*element).q.coeffs(), Eigen::Quaterniond::Identity().coeffs());
  const Pose pose{{0.1, -1.0 / 3, 1e-9}, Eigen::Quaterniond(0.1, -0.2, 0.3, 0.4).normalized()};
  SetPose(*element, pose);
  EXPECT_EQ(PoseOf(*element).p, pose.p) << "to the last bit";
  EXPECT_LT((PoseOf(*element).q.coeffs() - pose.q.coeffs()).norm(), 1e-15);
}

}  // namespace mjcf_document_test
}  // namespace etude::sim
