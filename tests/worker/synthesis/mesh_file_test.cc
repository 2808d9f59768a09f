// SPDX-License-Identifier: Apache-2.0
// Tests worker/synthesis/mesh_file.cc and picture_file.cc
#include "worker/synthesis/mesh_file.h"

#include <gmock/gmock.h>

#include <utility>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "worker/synthesis/drawn_object.h"
#include "worker/synthesis/generator.h"
#include "worker/synthesis/heightfield.h"
#include "worker/synthesis/mass.h"
#include "worker/synthesis/object_maker.h"
#include "worker/synthesis/picture_file.h"

namespace etude::synthesis {
namespace mesh_file_test {

constexpr const char* kTetrahedronStl = R"(solid t
facet normal 0 0 -1
 outer loop
  vertex 0 0 0
  vertex 0 1 0
  vertex 1 0 0
 endloop
endfacet
facet normal 0 -1 0
 outer loop
  vertex 0 0 0
  vertex 1 0 0
  vertex 0 0 1
 endloop
endfacet
facet normal -1 0 0
 outer loop
  vertex 0 0 0
  vertex 0 0 1
  vertex 0 1 0
 endloop
endfacet
facet normal 1 1 1
 outer loop
  vertex 1 0 0
  vertex 0 1 0
  vertex 0 0 1
 endloop
endfacet
endsolid t
)";

constexpr const char* kTetrahedronPly = R"(ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 0 1
3 0 2 1
3 0 1 3
3 0 3 2
3 1 2 3
)";

// two nodes with the same tetrahedron, one moved by 5 along x and made twice as large
constexpr const char* kTwoTetrahedraDae = R"(<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array><technique_common>
<accessor source="#pa" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s">
<node id="a"><instance_geometry url="#g"/></node>
<node id="b"><translate>5 0 0</translate><scale>2 2 2</scale><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
)";

/// Writes `text` to a file and reads it as a mesh.
Result<FileMesh> ReadText(const TemporaryFolder& folder, const std::string& name, const std::string& text) {
  EXPECT_THAT(WriteFileAtomically(folder.path() / name, text), IsOk());
  return ReadMesh(folder.path() / name);
}

TEST(MeshFile, RoundTripKeepsTheMesh) {
  const TemporaryFolder folder;
  const auto body = RaiseHeightfield(Draw("pear", 1).value());
  ASSERT_THAT(body, IsOk());
  ASSERT_THAT(WriteFileAtomically(folder.path() / "skin.png", EncodePng(TextureOf(Draw("pear", 1).value())).value()),
              IsOk());
  ASSERT_THAT(WriteMesh(folder.path() / "pear.obj", body->mesh, "skin.png"), IsOk());
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "pear.mtl"));

  const auto read = ReadMesh(folder.path() / "pear.obj");
  ASSERT_THAT(read, IsOk());
  EXPECT_FALSE(read->picture.empty());
  EXPECT_TRUE(IsWatertight(read->mesh));
  EXPECT_EQ(read->mesh.faces.size(), body->mesh.faces.size());
  const MassProperties before = Integrate(body->mesh), after = Integrate(read->mesh);
  EXPECT_NEAR(after.mass, before.mass, 1e-5 * before.mass);
  EXPECT_LT((after.centre - before.centre).norm(), 1e-5);
  for (std::size_t f = 0; f < 50; ++f)
    for (int k = 0; k < 3; ++k) {
      const int i = body->mesh.faces[f][k], j = read->mesh.faces[f][k];
      EXPECT_LT((body->mesh.positions[i] - read->mesh.positions[j]).norm(), 1e-5);
      EXPECT_LT((body->mesh.uv[i] - read->mesh.uv[j]).norm(), 1e-5);
    }
}

TEST(MeshFile, OtherFormatsKeepShapeToo) {
  const TemporaryFolder folder;
  const assets::Mesh mesh = DrawObject("donut", 1, 1)->visual;
  const MassProperties before = Integrate(mesh);
  for (const char* name : {"d.ply", "d.stl", "d.dae", "d.glb"}) {
    ASSERT_THAT(WriteMesh(folder.path() / name, mesh), IsOk()) << name;
    const auto read = ReadMesh(folder.path() / name);
    ASSERT_THAT(read, IsOk()) << name;
    EXPECT_EQ(read->mesh.faces.size(), mesh.faces.size()) << name;
    EXPECT_TRUE(IsWatertight(read->mesh)) << name;
    const MassProperties after = Integrate(read->mesh);
    EXPECT_NEAR(after.mass, before.mass, 1e-4 * before.mass) << name;
    EXPECT_LT((after.centre - before.centre).norm(), 1e-5) << name;
    EXPECT_NEAR(after.inertia.trace(), before.inertia.trace(), 1e-3 * before.inertia.trace()) << name;
  }
  EXPECT_THAT(WriteMesh(folder.path() / "d.xyz", mesh), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(WriteMesh("/proc/none/d.glb", mesh), HasCode(Code::kUnavailable));
}

TEST(MeshFile, ReadsStlAndPlyWithSharedVertices) {
  const TemporaryFolder folder;
  for (const auto& [name, text] : {std::pair{"t.stl", kTetrahedronStl}, {"t.ply", kTetrahedronPly}}) {
    const auto read = ReadText(folder, name, text);
    ASSERT_THAT(read, IsOk());
    EXPECT_EQ(read->mesh.faces.size(), 4u) << name;
    EXPECT_TRUE(IsWatertight(read->mesh)) << name;
    EXPECT_NEAR(Integrate(read->mesh).mass, 1.0 / 6, 1e-6) << name;
  }
}

TEST(MeshFile, MergesNodesWithTheirTransforms) {
  const TemporaryFolder folder;
  const auto read = ReadText(folder, "two.dae", kTwoTetrahedraDae);
  ASSERT_THAT(read, IsOk());
  EXPECT_EQ(read->mesh.faces.size(), 8u);
  EXPECT_NEAR(Integrate(read->mesh).mass, (1 + 8) / 6.0, 1e-5);
  double farthest = 0;
  for (const auto& p : read->mesh.positions) farthest = std::max(farthest, p.x());
  EXPECT_NEAR(farthest, 7, 1e-5);
}

TEST(MeshFile, NamesWhatIsWrong) {
  const TemporaryFolder folder;
  EXPECT_THAT(ReadMesh(folder.path() / "none.obj"), HasCode(Code::kNotFound));
  EXPECT_THAT(ReadText(folder, "empty.obj", ""), HasCode(Code::kCorrupt));
  EXPECT_THAT(ReadText(folder, "text.stl", "no mesh at all"), HasCode(Code::kCorrupt));
  EXPECT_THAT(ReadText(folder, "points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"), HasCode(Code::kCorrupt));
  EXPECT_THAT(ReadText(folder, "flat.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(ReadText(folder, "line.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(WriteMesh(folder.path() / "a.glb", {}), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(WriteMesh(folder.path() / "a.obj", {}), HasCode(Code::kInvalidArgument));
}

TEST(ImportObject, ScalesCentresAndWeighs) {
  const TemporaryFolder folder;
  ASSERT_THAT(WriteFileAtomically(folder.path() / "t.stl", std::string_view(kTetrahedronStl)), IsOk());
  const auto object = ImportObject(folder.path() / "t.stl", {.name = "wedge", .size_m = 0.06, .density = 1000});
  ASSERT_THAT(object, IsOk());
  EXPECT_NEAR(object->facts.mass_kg, 1000 * 0.06 * 0.06 * 0.06 / 6, 1e-4);
  EXPECT_NEAR(object->facts.rest_height_m, 0.03, 1e-6);
  EXPECT_FALSE(object->texture.rgb.empty());
  EXPECT_THAT(ImportObject(folder.path() / "t.stl", {.name = "../x"}), HasCode(Code::kInvalidArgument));
}

// as a mirrored part or a scan may be wound: seen from inside, and with the mass of its hull
TEST(ImportObject, TurnsRoundWhatIsWoundInwards) {
  const TemporaryFolder folder;
  std::string inwards = kTetrahedronPly;
  for (const auto& [face, turned] :
       {std::pair{"3 0 2 1", "3 0 1 2"}, {"3 0 1 3", "3 0 3 1"}, {"3 0 3 2", "3 0 2 3"}, {"3 1 2 3", "3 1 3 2"}})
    inwards.replace(inwards.find(face, inwards.find("0 0 1\n3")), 7, turned);
  ASSERT_THAT(WriteFileAtomically(folder.path() / "t.ply", inwards), IsOk());
  const auto object = ImportObject(folder.path() / "t.ply", {.name = "wedge", .size_m = 0.06, .density = 1000});
  ASSERT_THAT(object, IsOk());
  EXPECT_GT(Integrate(object->visual).mass, 0);
  EXPECT_NEAR(object->facts.mass_kg, 1000 * 0.06 * 0.06 * 0.06 / 6, 1e-4);
}

TEST(ImportObject, TurnsRoundAScanWithAHole) {
  const TemporaryFolder folder;
  std::string open = kTetrahedronPly;
  for (const auto& [face, turned] : {std::pair{"3 0 1 3", "3 0 3 1"}, {"3 0 3 2", "3 0 2 3"}, {"3 1 2 3", "3 1 3 2"}})
    open.replace(open.find(face, open.find("0 0 1\n3")), 7, turned);
  open.replace(open.find("element face 4"), 14, "element face 3");
  open.erase(open.find("3 0 2 1", open.find("0 0 1\n3")), 8);
  ASSERT_THAT(WriteFileAtomically(folder.path() / "t.ply", open), IsOk());
  const auto object = ImportObject(folder.path() / "t.ply", {.name = "wedge", .size_m = 0.06, .density = 1000});
  ASSERT_THAT(object, IsOk());
  EXPECT_GT(Integrate(object->visual).mass, 0);
}

TEST(PictureFile, ReadsWhatItWrites) {
  const TemporaryFolder folder;
  const Picture drawn = Draw("donut", 2).value();
  const Path rgb = folder.path() / "d.png", depth = folder.path() / "d-depth.png";
  ASSERT_THAT(WriteFileAtomically(rgb, EncodePng({drawn.width, drawn.height, drawn.rgb}).value()), IsOk());
  ASSERT_THAT(WriteFileAtomically(depth, EncodeDepth(drawn).value()), IsOk());

  const auto read = ReadPicture(rgb, depth, drawn.relief);
  ASSERT_THAT(read, IsOk());
  EXPECT_EQ(read->mask, drawn.mask);
  EXPECT_EQ(read->width, drawn.width);
  double worst = 0;
  for (std::size_t i = 0; i < drawn.pixels(); ++i)
    worst = std::max(worst, std::abs(static_cast<double>(read->depth[i]) - drawn.depth[i]));
  EXPECT_LT(worst, 0.051);  // the object's farthest point is lifted over the cut
  const auto body = RaiseHeightfield(*read);
  ASSERT_THAT(body, IsOk());
  EXPECT_TRUE(body->hole.has_value());

  EXPECT_THAT(ReadPicture(rgb, rgb, 0.4), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(ReadPicture(rgb, folder.path() / "none.png", 0.4), HasCode(Code::kNotFound));
  ASSERT_THAT(WriteFileAtomically(depth, std::string_view("no picture")), IsOk());
  EXPECT_THAT(ReadPicture(rgb, depth, 0.4), HasCode(Code::kCorrupt));
}

}  // namespace mesh_file_test
}  // namespace etude::synthesis
