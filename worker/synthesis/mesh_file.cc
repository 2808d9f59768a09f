// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/mesh_file.h"

#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <assimp/Exporter.hpp>
#include <assimp/Importer.hpp>
#include <cmath>
#include <iterator>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>

#include "services/core/log.h"

namespace etude::synthesis {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr unsigned kSteps = aiProcess_Triangulate | aiProcess_RemoveComponent | aiProcess_GenSmoothNormals |
                            aiProcess_JoinIdenticalVertices | aiProcess_PreTransformVertices |
                            aiProcess_FindDegenerates | aiProcess_SortByPType | aiProcess_FlipUVs;

void Configure(Assimp::Importer& importer) {
  importer.SetPropertyInteger(AI_CONFIG_PP_RVC_FLAGS, aiComponent_NORMALS | aiComponent_TANGENTS_AND_BITANGENTS |
                                                          aiComponent_BONEWEIGHTS | aiComponent_ANIMATIONS |
                                                          aiComponent_LIGHTS | aiComponent_CAMERAS);
  importer.SetPropertyFloat(AI_CONFIG_PP_GSN_MAX_SMOOTHING_ANGLE, 60);
  importer.SetPropertyInteger(AI_CONFIG_PP_SBP_REMOVE, aiPrimitiveType_POINT | aiPrimitiveType_LINE);
  importer.SetPropertyBool(AI_CONFIG_PP_FD_REMOVE, true);
  // else it takes faces under 1e-6 square units for degenerate: those of any fine mesh in metres
  importer.SetPropertyBool(AI_CONFIG_PP_FD_CHECKAREA, false);
}

Vector3d ToVector(const aiVector3D& v) { return {v.x, v.y, v.z}; }

/// The one picture that all materials in use show; "" when there is none or there are several, which is logged.
std::string CommonPicture(const aiScene& scene, const Path& path) {
  std::set<std::string> names;
  for (unsigned i = 0; i < scene.mNumMeshes; ++i) {
    aiString name;
    scene.mMaterials[scene.mMeshes[i]->mMaterialIndex]->GetTexture(aiTextureType_DIFFUSE, 0, &name);
    names.insert(scene.mMeshes[i]->HasTextureCoords(0) ? name.C_Str() : "");
  }
  if (names.size() == 1) return *names.begin();
  names.erase("");
  Log().warn(
      "'{}': left out its {} ({}), not all of it shows the same one: an object has one texture; its materials' "
      "colours are taken",
      path.string(), names.size() == 1 ? "picture" : "pictures", fmt::join(names, ", "));
  return "";
}

/// The bytes of that picture: inside of the file or beside it; empty when it cannot be had.
std::vector<std::uint8_t> PictureBytes(const aiScene& scene, const Path& path, const std::string& name) {
  if (name.empty()) return {};
  if (const aiTexture* inside = scene.GetEmbeddedTexture(name.c_str())) {
    if (inside->mHeight != 0) return {};  // raw pixels, which no format in common use has
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(inside->pcData);
    return {bytes, bytes + inside->mWidth};
  }
  auto beside = ReadBinaryFile(path.parent_path() / name, 1u << 28);
  if (beside) return std::move(*beside);
  Log().warn("'{}': left out its picture: {}; its materials' colours are taken", path.string(), beside.error().message);
  return {};
}

Vector3d DiffuseColor(const aiMaterial& material) {
  aiColor4D color(0.7f, 0.7f, 0.7f, 1);
  material.Get(AI_MATKEY_COLOR_DIFFUSE, color);
  return {color.r, color.g, color.b};
}

/// @param column  where the mesh's material is in the palette; nothing: the mesh's own texture coordinates
void Append(const aiMesh& source, std::optional<double> column, assets::Mesh& mesh) {
  const int first = static_cast<int>(mesh.positions.size());
  for (unsigned i = 0; i < source.mNumVertices; ++i) {
    mesh.positions.push_back(ToVector(source.mVertices[i]));
    mesh.normals.push_back(source.HasNormals() ? ToVector(source.mNormals[i]) : Vector3d::UnitZ());
    mesh.uv.push_back(column ? Vector2d(*column, 0.5)
                             : Vector2d(source.mTextureCoords[0][i].x, source.mTextureCoords[0][i].y));
  }
  for (unsigned i = 0; i < source.mNumFaces; ++i) {
    const aiFace& face = source.mFaces[i];
    if (face.mNumIndices != 3) continue;
    mesh.faces.push_back({first + static_cast<int>(face.mIndices[0]), first + static_cast<int>(face.mIndices[1]),
                          first + static_cast<int>(face.mIndices[2])});
  }
}

Status CheckExtent(const assets::Mesh& mesh, const Path& path) {
  Vector3d low = mesh.positions[0], high = low;
  bool is_finite = true;
  for (const Vector3d& p : mesh.positions) {
    is_finite = is_finite && p.allFinite();
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Vector3d extent = high - low;
  if (is_finite && extent.minCoeff() > 1e-6 * extent.maxCoeff()) return {};
  return Fail(Code::kInvalidArgument, fmt::format("read '{}': the mesh is degenerate, its extent {} x {} x {}",
                                                  path.string(), extent.x(), extent.y(), extent.z()));
}

}  // namespace

Result<FileMesh> ReadMesh(const Path& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error))
    return Fail(Code::kNotFound, fmt::format("read '{}': no such file", path.string()));
  Assimp::Importer importer;
  Configure(importer);
  const aiScene* scene = importer.ReadFile(path.string(), kSteps);
  if (!scene) return Fail(Code::kCorrupt, fmt::format("read '{}': {}", path.string(), importer.GetErrorString()));

  FileMesh result;
  result.picture = PictureBytes(*scene, path, CommonPicture(*scene, path));
  for (unsigned i = 0; i < scene->mNumMaterials; ++i) result.palette.push_back(DiffuseColor(*scene->mMaterials[i]));
  for (unsigned i = 0; i < scene->mNumMeshes; ++i) {
    const aiMesh& mesh = *scene->mMeshes[i];
    const double column = (mesh.mMaterialIndex + 0.5) / std::max(1u, scene->mNumMaterials);
    Append(mesh, result.picture.empty() ? std::optional(column) : std::nullopt, result.mesh);
  }
  const std::span meshes(scene->mMeshes, scene->mNumMeshes);
  if (result.picture.empty() &&
      std::ranges::any_of(meshes, [](const aiMesh* mesh) { return mesh->HasVertexColors(0); }))
    Log().warn("'{}': left out its vertices' colours: an object has one texture; its materials' colours are taken",
               path.string());
  if (!result.picture.empty()) result.palette.clear();
  if (result.mesh.faces.empty())
    return Fail(Code::kCorrupt, fmt::format("read '{}': it has no faces of any area", path.string()));
  ETUDE_RETURN_IF_ERROR(CheckExtent(result.mesh, path));
  return result;
}

namespace {

/// Our own text: the same bytes whatever the version of assimp.
Status WriteObj(const Path& path, const assets::Mesh& mesh, const std::string& texture) {
  const Path library = Path(path).replace_extension(".mtl");
  std::string text;
  auto out = std::back_inserter(text);
  if (!texture.empty()) fmt::format_to(out, "mtllib {}\nusemtl surface\n", library.filename().string());
  for (const auto& p : mesh.positions) fmt::format_to(out, "v {:.7f} {:.7f} {:.7f}\n", p.x(), p.y(), p.z());
  // Wavefront's rows run from below
  for (const auto& t : mesh.uv) fmt::format_to(out, "vt {:.6f} {:.6f}\n", t.x(), 1 - t.y());
  for (const auto& n : mesh.normals) fmt::format_to(out, "vn {:.5f} {:.5f} {:.5f}\n", n.x(), n.y(), n.z());
  for (const auto& f : mesh.faces) {
    const int a = f[0] + 1, b = f[1] + 1, c = f[2] + 1;
    fmt::format_to(out, "f {}/{}/{} {}/{}/{} {}/{}/{}\n", a, a, a, b, b, b, c, c, c);
  }
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(path, text));
  if (texture.empty()) return {};
  return WriteFileAtomically(library, fmt::format("newmtl surface\nKa 1 1 1\nKd 1 1 1\nmap_Kd {}\n", texture));
}

aiVector3D FromVector(const Vector3d& v) {
  return {static_cast<ai_real>(v.x()), static_cast<ai_real>(v.y()), static_cast<ai_real>(v.z())};
}

/// What assimp writes; it owns and deletes what is made with new here.
aiMesh* MakeAiMesh(const assets::Mesh& mesh) {
  auto* made = new aiMesh;
  made->mPrimitiveTypes = aiPrimitiveType_TRIANGLE;
  made->mNumVertices = static_cast<unsigned>(mesh.positions.size());
  made->mVertices = new aiVector3D[made->mNumVertices];
  made->mNormals = new aiVector3D[made->mNumVertices];
  made->mTextureCoords[0] = new aiVector3D[made->mNumVertices];
  made->mNumUVComponents[0] = 2;
  for (unsigned i = 0; i < made->mNumVertices; ++i) {
    made->mVertices[i] = FromVector(mesh.positions[i]);
    made->mNormals[i] = FromVector(mesh.normals[i]);
    made->mTextureCoords[0][i] = FromVector({mesh.uv[i].x(), 1 - mesh.uv[i].y(), 0});
  }
  made->mNumFaces = static_cast<unsigned>(mesh.faces.size());
  made->mFaces = new aiFace[made->mNumFaces];
  for (unsigned i = 0; i < made->mNumFaces; ++i) {
    made->mFaces[i].mNumIndices = 3;
    made->mFaces[i].mIndices = new unsigned[3];
    for (int k = 0; k < 3; ++k) made->mFaces[i].mIndices[k] = static_cast<unsigned>(mesh.faces[i][k]);
  }
  return made;
}

std::unique_ptr<aiScene> MakeScene(const assets::Mesh& mesh, const std::string& texture) {
  auto scene = std::make_unique<aiScene>();
  scene->mNumMeshes = scene->mNumMaterials = 1;
  scene->mMeshes = new aiMesh* [1] { MakeAiMesh(mesh) };
  auto* material = new aiMaterial;
  const aiColor4D white(1, 1, 1, 1);
  material->AddProperty(&white, 1, AI_MATKEY_COLOR_DIFFUSE);
  if (const aiString name(texture); !texture.empty()) material->AddProperty(&name, AI_MATKEY_TEXTURE_DIFFUSE(0));
  scene->mMaterials = new aiMaterial* [1] { material };
  scene->mRootNode = new aiNode("object");
  scene->mRootNode->mNumMeshes = 1;
  scene->mRootNode->mMeshes = new unsigned[1]{0};
  return scene;
}

}  // namespace

Status WriteMesh(const Path& path, const assets::Mesh& mesh, const std::string& texture) {
  static const std::map<std::string, const char*> formats{
      {".obj", "obj"}, {".ply", "plyb"}, {".stl", "stlb"}, {".dae", "collada"}, {".glb", "glb2"}};
  const auto format = formats.find(path.extension().string());
  if (format == formats.end())
    return Fail(Code::kInvalidArgument,
                fmt::format("write '{}': only .obj, .ply, .stl, .dae and .glb are written", path.string()));
  if (mesh.faces.empty() || mesh.uv.size() != mesh.positions.size() || mesh.normals.size() != mesh.positions.size())
    return Fail(Code::kInvalidArgument,
                fmt::format("write '{}': {} faces, {} positions, {} normals, {} texture coordinates", path.string(),
                            mesh.faces.size(), mesh.positions.size(), mesh.normals.size(), mesh.uv.size()));
  if (format->first == ".obj") return WriteObj(path, mesh, texture);
  std::error_code error;
  std::filesystem::create_directories(path.has_parent_path() ? path.parent_path() : Path("."), error);
  const auto scene = MakeScene(mesh, texture);
  Assimp::Exporter exporter;
  if (exporter.Export(scene.get(), format->second, path.string()) == AI_SUCCESS) return {};
  return Fail(Code::kUnavailable, fmt::format("write '{}': {}", path.string(), exporter.GetErrorString()));
}

}  // namespace etude::synthesis
