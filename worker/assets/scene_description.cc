// SPDX-License-Identifier: Apache-2.0
#include "worker/assets/scene_description.h"

#include <fmt/format.h>

#include <set>

#include "services/core/hash.h"
#include "services/spec/episode_world.h"
#include "worker/assets/geom_writer.h"
#include "worker/assets/object_parts.h"
#include "worker/assets/shifted_world.h"

namespace etude::assets {
namespace {

// 500 Hz; elliptic cones with a stiff tangential part keep a grasp from creeping, Newton solves
// them in a few iterations. Robot pieces (type 2) meet table and objects (type 1), never each
// other: keeping the arm off itself is the planner's business.
constexpr const char* kHead = R"(<mujoco model="etude">
<compiler angle="radian" autolimits="true" inertiafromgeom="auto"/>
<option timestep="{timestep}" integrator="Euler" solver="Newton" jacobian="sparse" iterations="60" tolerance="1e-10" cone="elliptic" impratio="10"/>
<size njmax="1200" nconmax="300"/>
<statistic extent="1" center="0 0.2 0.1" meansize="0.05"/>
<visual>
<global offwidth="{width}" offheight="{height}" fovy="45"/>
<quality shadowsize="1024" offsamples="0" numslices="20" numstacks="10" numquads="2"/>
<map znear="0.02" zfar="12"/>
<headlight ambient="0.34 0.34 0.34" diffuse="0.42 0.42 0.42" specular="0.25 0.25 0.25"/>
</visual>
<default>
<default class="visual"><geom contype="0" conaffinity="0" group="2" mass="0"/></default>
<default class="object"><geom contype="1" conaffinity="3" group="3" condim="4" friction="0.9 0.02 0.001" solref="0.006 1" solimp="0.95 0.99 0.001" rgba="0.4 0.4 0.9 0.5"/></default>
<default class="object_round"><geom {round}/></default>
<default class="object_foot"><geom {foot}/></default>
{defaults}</default>
)";

/// <mesh> and <texture> elements for the files, each once, but for those that are declared already.
std::string Assets(const std::vector<AssetFile>& offered, std::vector<AssetFile>& kept) {
  std::set<std::string> seen;
  std::string text;
  for (const AssetFile& file : offered) {
    if (!seen.insert(file.name).second) continue;
    const std::string stem = file.name.substr(0, file.name.rfind('.'));
    kept.push_back(file);
    if (file.declared) continue;
    if (file.name.ends_with(".msh") || file.name.ends_with(".obj"))
      text += fmt::format("<mesh name=\"{}\" file=\"{}\"/>\n", stem, file.name);
    else
      text += fmt::format("<texture name=\"{}\" type=\"2d\" file=\"{}\"/>\n", stem, file.name);
  }
  return text;
}

Result<Camera> MakeCamera(const CameraSpec& spec) {
  if (spec.position.size() != 3 || spec.euler.size() != 3)
    return Fail(Code::kInvalidArgument, fmt::format("camera: position has {} and euler {} numbers, each needs 3",
                                                    spec.position.size(), spec.euler.size()));
  return ToCamera(spec);
}

std::string World(const SceneDescription& scene, const CameraSpec& camera) {
  std::string text =
      "<light name=\"sun\" directional=\"true\" pos=\"-0.5 0.5 3\" dir=\"-0.10 -0.45 -1\" "
      "castshadow=\"false\" "
      "ambient=\"0.02 0.02 0.02\" diffuse=\"0.52 0.52 0.52\" specular=\"0.2 0.2 0.2\"/>\n";
  // fovy is in degrees whatever the compiler's angle
  text += fmt::format("<camera name=\"{}\" mode=\"fixed\" fovy=\"{}\"{}/>\n", scene.camera.name, camera.fovy_deg,
                      PoseAttributes(scene.camera.X_WC));
  text +=
      "<geom name=\"table\" type=\"plane\" size=\"0.75 0.75 0.05\" material=\"table\" "
      "contype=\"1\" "
      "conaffinity=\"3\" friction=\"0.9 0.005 0.0001\" solref=\"0.006 1\" solimp=\"0.95 0.99 "
      "0.001\"/>\n";
  text += scene.robot.body;
  const double spacing = 0.14, first = -spacing * (static_cast<double>(scene.objects.size()) - 1) / 2;
  for (std::size_t i = 0; i < scene.objects.size(); ++i) {
    const ObjectModel& object = scene.objects[i];
    text += fmt::format("<body name=\"{0}\" pos=\"{1} 0.3 {2}\">\n<freejoint name=\"{0}\"/>\n{3}</body>\n", object.name,
                        first + spacing * static_cast<double>(i), object.rest_height, object.geoms);
  }
  return text;
}

std::string Digest(const SceneDescription& scene) {
  Sha256 hash;
  hash.Update(fmt::format("{} bytes of MJCF\n", scene.mjcf.size()));
  hash.Update(scene.mjcf);
  for (const AssetFile& file : scene.files) {
    hash.Update(fmt::format("\n{} {}\n", file.name, file.bytes.size()));
    hash.Update(file.bytes);
  }
  return ToHex(hash.Finish());
}

}  // namespace

Result<SceneDescription> DescribeScene(const SceneSpec& spec, RobotModel robot, const ObjectMaker& make_object) {
  SceneDescription scene;
  scene.robot = std::move(robot);
  ETUDE_ASSIGN_OR_RETURN(scene.camera, MakeCamera(spec.camera));
  std::vector<AssetFile> offered = scene.robot.files;
  offered.push_back({"wood.tex", WoodTexture().ToTexture()});
  std::set<std::string> names;
  for (const std::string& name : spec.objects) {
    if (!names.insert(name).second)
      return Fail(Code::kInvalidArgument, fmt::format("objects: '{}' is named twice", name));
    ETUDE_ASSIGN_OR_RETURN(ObjectModel object, make_object(name));
    offered.insert(offered.end(), object.files.begin(), object.files.end());
    scene.objects.push_back(std::move(object));
  }
  std::string mjcf = fmt::format(kHead, fmt::arg("timestep", kTimestep), fmt::arg("width", spec.camera.width),
                                 fmt::arg("height", spec.camera.height), fmt::arg("round", kRoundObjectContact),
                                 fmt::arg("foot", kFootContact), fmt::arg("defaults", scene.robot.defaults));
  mjcf += "<asset>\n" + Assets(offered, scene.files) + scene.robot.materials;
  mjcf +=
      "<material name=\"table\" texture=\"wood\" texrepeat=\"1 1\" specular=\"0\" "
      "shininess=\"0\"/>\n";
  for (const ObjectModel& object : scene.objects) mjcf += object.materials;
  mjcf += "</asset>\n<worldbody>\n" + World(scene, spec.camera) + "</worldbody>\n";
  mjcf += "<equality>\n" + scene.robot.equality + "</equality>\n";
  if (!scene.robot.tendon.empty()) mjcf += "<tendon>\n" + scene.robot.tendon + "</tendon>\n";
  mjcf += "<actuator>\n" + scene.robot.actuator + "</actuator>\n</mujoco>\n";
  scene.mjcf = std::move(mjcf);
  ShiftWorld(spec.world, scene);
  AddChoices(spec, scene);
  scene.sha256 = Digest(scene);
  return scene;
}

}  // namespace etude::assets
