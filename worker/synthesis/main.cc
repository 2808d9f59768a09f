// SPDX-License-Identifier: Apache-2.0
// etude-object: makes objects from drawings or pictures, imports them from mesh files, shows them.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <thread>

#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/command_table.h"
#include "services/core/config.h"
#include "services/core/cores.h"
#include "services/core/stop.h"
#include "worker/synthesis/depth_network.h"
#include "worker/synthesis/drawn_object.h"
#include "worker/synthesis/generator.h"
#include "worker/synthesis/mesh_file.h"
#include "worker/synthesis/object_maker.h"
#include "worker/synthesis/picture_file.h"
#include "worker/synthesis/scene_object.h"
#include "worker/synthesis/shaded_view.h"

namespace etude::synthesis {
namespace {

struct Arguments {
  // synthesize
  std::vector<std::string> classes{"all"};
  int per_class = 10;
  std::uint64_t seed = 1;
  std::string images, depth_network;
  double relief = 0.35;
  std::string view = "top";
  int threads = Cores();
  // both
  double size_m = 0;
  double density = 600;
  std::string out = "objects";
  // import
  std::string file;
  std::string name;
  std::string up = "auto";
  bool overwrite = false;
  // gallery
  std::string folder;
  std::string sheet = "objects.png";
  int columns = 10;
  int tile = 160;  // px
};

Result<std::vector<Maker>> DrawnObjects(const Arguments& arguments) {
  std::vector<std::string> names;
  for (const std::string& name : arguments.classes)
    if (name == "all")
      for (const ClassFacts& known : KnownClasses()) names.push_back(known.name);
    else
      names.push_back(name);
  std::vector<Maker> makers;
  for (const std::string& name : names) {
    ETUDE_ASSIGN_OR_RETURN(const ClassFacts known, FindClass(name));
    for (int i = 0; i < arguments.per_class; ++i)
      makers.push_back([=] { return DrawObject(known.name, i, arguments.seed, arguments.size_m); });
  }
  return makers;
}

/// The pictures NAME.png of a folder, by name; only those with a NAME-depth.png beside when depth is needed.
Result<std::vector<Path>> PicturesIn(const Path& folder, bool needs_depth) {
  std::error_code error;
  std::vector<Path> pictures;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    const std::string name = entry.path().stem().string();
    if (entry.path().extension() != ".png" || name.ends_with("-depth")) continue;
    if (!needs_depth || std::filesystem::exists(folder / (name + "-depth.png"))) pictures.push_back(entry.path());
  }
  if (error) return Fail(ErrnoError("list", folder, error.value()));
  if (pictures.empty())
    return Fail(Code::kNotFound, fmt::format("'{}' has no {}", folder.string(),
                                             needs_depth ? "pair NAME.png, NAME-depth.png" : "NAME.png"));
  std::sort(pictures.begin(), pictures.end());
  return pictures;
}

/// How a picture gets its depth: from the picture beside it, or from a network, one call at a time.
using DepthSource = std::function<Result<Picture>(const Path&)>;
Result<DepthSource> MakeDepthSource(const Arguments& arguments) {
  if (arguments.depth_network.empty())
    return DepthSource([=](const Path& rgb) {
      return ReadPicture(rgb, rgb.parent_path() / (rgb.stem().string() + "-depth.png"), arguments.relief);
    });
  ETUDE_ASSIGN_OR_RETURN(DepthNetwork opened,
                         DepthNetwork::Open(arguments.depth_network, {.relief = arguments.relief}));
  auto network = std::make_shared<DepthNetwork>(std::move(opened));
  auto one_call = std::make_shared<std::mutex>();
  return DepthSource([=](const Path& rgb) {
    const std::lock_guard lock(*one_call);
    return network->Read(rgb);
  });
}

Result<std::vector<Maker>> PicturedObjects(const Arguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto read, MakeDepthSource(arguments));
  ETUDE_ASSIGN_OR_RETURN(const auto pictures, PicturesIn(arguments.images, arguments.depth_network.empty()));
  std::vector<Maker> makers;
  for (const Path& rgb : pictures) {
    const std::string name = rgb.stem().string();
    if (!IsPlainName(name))
      return Fail(Code::kInvalidArgument,
                  fmt::format("'{}': its name becomes the object's: a-z, 0-9, _ and -, at most 64", rgb.string()));
    makers.push_back([=]() -> Result<SolidObject> {
      ETUDE_ASSIGN_OR_RETURN(Picture picture, read(rgb));
      picture.view = arguments.view == "front" ? View::kFront : View::kTop;
      ObjectFacts facts{.name = name,
                        .class_name = name,
                        .source = "picture",
                        .size_m = arguments.size_m > 0 ? arguments.size_m : 0.08};
      auto object = ObjectFromPicture(std::move(facts), picture, {.density = arguments.density});
      if (!object) return Fail(object.error().Wrap(rgb.string()));
      return object;
    });
  }
  return makers;
}

void PrintObject(const ObjectFacts& facts) {
  fmt::print("{:<16} {:5.1f} cm {:6.1f} g  {:5} faces {:3} pieces  {}\n", facts.name, 100 * facts.size_m,
             1000 * facts.mass_kg, facts.faces, facts.pieces, facts.split);
  std::fflush(stdout);
}

bool IsTaken(const Arguments& arguments, const std::string& name) {
  std::error_code error;
  return !arguments.overwrite && std::filesystem::exists(Path(arguments.out) / name / "object.yaml", error);
}

// What is there already is made again where it comes out the same: begun again, a command goes on.
Maker KeepingOthers(const Maker& make, const Arguments& arguments) {
  return [=]() -> Result<SolidObject> {
    ETUDE_ASSIGN_OR_RETURN(SolidObject object, make());
    const Path folder = Path(arguments.out) / object.facts.name;
    if (!IsTaken(arguments, object.facts.name)) return object;
    const auto there = ReadObjectFacts(folder);
    if (there && ToJson(*there) == ToJson(object.facts)) return object;
    return Fail(Code::kInvalidArgument,
                fmt::format("synthesize '{}': '{}' is another object already; give another --out, or --overwrite to "
                            "have it made anew",
                            object.facts.name, folder.string()));
  };
}

Status Synthesize(const Arguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(auto makers, arguments.images.empty() ? DrawnObjects(arguments) : PicturedObjects(arguments));
  for (Maker& maker : makers) maker = KeepingOthers(maker, arguments);
  Stopwatch elapsed;
  ETUDE_ASSIGN_OR_RETURN(const auto objects, MakeObjects(makers, arguments.out, arguments.threads, PrintObject));
  std::map<std::string, int> of_split;
  for (const ObjectFacts& facts : objects) ++of_split[facts.split];
  fmt::print("{} objects ({} train, {} test) in {} in {:.1f} s\n", objects.size(), of_split["train"], of_split["test"],
             arguments.out, elapsed.Seconds());
  if (objects.size() < makers.size())
    return Fail(Code::kExhausted, fmt::format("stopped after {} of {} objects", objects.size(), makers.size()));
  return {};
}

UpAxis UpOf(const Arguments& arguments) {
  if (arguments.up != "auto") return arguments.up == "y" ? UpAxis::kY : UpAxis::kZ;
  // these formats say so themselves
  std::string suffix = Path(arguments.file).extension().string();
  std::ranges::transform(suffix, suffix.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return suffix == ".glb" || suffix == ".gltf" || suffix == ".dae" ? UpAxis::kY : UpAxis::kZ;
}

Status Import(const Arguments& arguments) {
  const ImportOptions options{.name = arguments.name.empty() ? Path(arguments.file).stem().string() : arguments.name,
                              .size_m = arguments.size_m > 0 ? arguments.size_m : ImportOptions{}.size_m,
                              .density = arguments.density,
                              .up = UpOf(arguments)};
  ETUDE_ASSIGN_OR_RETURN(const SolidObject object, ImportObject(arguments.file, options));
  const Path folder = Path(arguments.out) / object.facts.name;
  if (IsTaken(arguments, object.facts.name))
    return Fail(Code::kInvalidArgument,
                fmt::format("import '{}': '{}' is an object already; give another --name, or --overwrite to have it "
                            "made anew",
                            arguments.file, folder.string()));
  ETUDE_RETURN_IF_ERROR(WriteObject(object, folder));
  PrintObject(object.facts);
  return {};
}

Status Gallery(const Arguments& arguments) {
  std::error_code error;
  std::vector<Path> folders;
  for (std::filesystem::directory_iterator item(arguments.folder, error), end; !error && item != end;
       item.increment(error)) {
    std::error_code unreadable;  // lost+found, say
    if (std::filesystem::exists(item->path() / "object.yaml", unreadable)) folders.push_back(item->path());
  }
  if (error) return Fail(ErrnoError("list", arguments.folder, error.value()));
  if (folders.empty()) return Fail(Code::kNotFound, fmt::format("'{}' has no objects", arguments.folder));
  std::sort(folders.begin(), folders.end());
  std::vector<ObjectFacts> objects;
  // one scale for all, so that they can be compared
  ViewOptions view{.size = arguments.tile};
  for (const Path& folder : folders) {
    ETUDE_ASSIGN_OR_RETURN(ObjectFacts facts, ReadObjectFacts(folder));
    view.extent = std::max(view.extent, 1.3 * facts.size_m);
    objects.push_back(std::move(facts));
  }
  std::vector<Tile> tiles;
  for (std::size_t i = 0; i < folders.size(); ++i) {
    const Path& folder = folders[i];
    const ObjectFacts& facts = objects[i];
    ETUDE_ASSIGN_OR_RETURN(const FileMesh read, ReadMesh(folder / "visual.obj"));
    ETUDE_ASSIGN_OR_RETURN(const Texture texture, DecodePicture(read.picture, folder.string()));
    tiles.push_back(
        {ShadedView(read.mesh, texture, view), fmt::format("{}  {:.0f} mm", facts.name, 1000 * facts.size_m)});
  }
  ETUDE_RETURN_IF_ERROR(WriteContactSheet(tiles, arguments.columns, arguments.sheet));
  fmt::print("{} objects in {}\n", tiles.size(), arguments.sheet);
  return {};
}

void AddOverwrite(CLI::App& command, Arguments& arguments) {
  command.add_flag("--overwrite", arguments.overwrite, "in the place of an object of that name");
}

CLI::App* AddSynthesize(CLI::App& app, Arguments& arguments) {
  auto* command = app.add_subcommand("synthesize", "objects from built-in drawings, or from pictures with depth");
  command->add_option("--classes", arguments.classes, "all, or some: apple,mug")->delimiter(',')->capture_default_str();
  command->add_option("--per-class", arguments.per_class, "instances of each; the first three are for training")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  command->add_option("--seed", arguments.seed, "other seeds give other objects")->capture_default_str();
  auto* images =
      command->add_option("--images", arguments.images,
                          "instead: folder of NAME.png and NAME-depth.png (16 bits, larger is nearer, 0 off)");
  command
      ->add_option("--depth-network", arguments.depth_network,
                   "ONNX file that gives NAME.png its depth, e.g. MiDaS v2.1 small: no NAME-depth.png is needed")
      ->needs(images);
  command->add_option("--relief", arguments.relief, "of --images: half the thickness, in widths of the picture")
      ->needs(images)
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--view", arguments.view, "of --images: seen from the front or from above")
      ->needs(images)
      ->check(CLI::IsMember({"front", "top"}))
      ->capture_default_str();
  command->add_option("--density", arguments.density, "of --images, kg/m^3")
      ->needs(images)
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--size", arguments.size_m, "largest extent, m; default: that of the class, 0.08 for --images")
      ->check(CLI::PositiveNumber);
  command->add_option("--threads", arguments.threads, "the objects do not depend on how many (default: one a core)")
      ->check(CLI::Range(1, 256));
  command->add_option("--out", arguments.out, "folder; each object gets one in it")->capture_default_str();
  AddOverwrite(*command, arguments);
  return command;
}

CLI::App* AddImport(CLI::App& app, Arguments& arguments) {
  auto* command = app.add_subcommand("import", "an object from a mesh file: .obj .ply .stl .dae .glb and more");
  command->add_option("file", arguments.file, "mesh file")->required();
  command->add_option("--name", arguments.name, "of the object; default: the file's");
  command->add_option("--size", arguments.size_m, "largest extent, m; default: 0.06")->check(CLI::PositiveNumber);
  command->add_option("--density", arguments.density, "kg/m^3")->check(CLI::PositiveNumber)->capture_default_str();
  command->add_option("--up", arguments.up, "the file's axis that points up; auto: y of .glb and .dae, else z")
      ->check(CLI::IsMember({"auto", "y", "z"}))
      ->capture_default_str();
  command->add_option("--out", arguments.out, "folder; the object gets one in it")->capture_default_str();
  AddOverwrite(*command, arguments);
  return command;
}

CLI::App* AddGallery(CLI::App& app, Arguments& arguments) {
  auto* command = app.add_subcommand("gallery", "a picture with a tile for each object of a folder");
  command->add_option("folder", arguments.folder, "what synthesize or import wrote")->required();
  command->add_option("--out", arguments.sheet, "picture, .png or .jpg")
      ->check(EndsWith({".png", ".jpg"}))
      ->capture_default_str();
  command->add_option("--tile", arguments.tile, "width and height of each, px")
      ->check(CLI::Range(32, 2048))
      ->capture_default_str();
  command->add_option("--columns", arguments.columns, "tiles in a row")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  return command;
}

}  // namespace
}  // namespace etude::synthesis

int main(int argc, char** argv) {
  namespace synthesis = etude::synthesis;
  synthesis::Arguments arguments;
  CLI::App app("Makes objects from drawings or pictures, imports them from mesh files, shows them.", "etude object");
  auto* synthesize = synthesis::AddSynthesize(app, arguments);
  auto* import = synthesis::AddImport(app, arguments);
  synthesis::AddGallery(app, arguments);
  app.require_subcommand(1);
  if (const auto ended = etude::ParseCommandLine(app, argc, argv)) return *ended;
  return etude::RunMain("etude-object", [&] {
    if (*synthesize) return synthesis::Synthesize(arguments);
    return *import ? synthesis::Import(arguments) : synthesis::Gallery(arguments);
  });
}
