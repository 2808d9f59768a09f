// SPDX-License-Identifier: Apache-2.0
// The world of one episode, drawn once (services/spec/world_randomization.h says from what).
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "services/episode/camera.h"
#include "services/spec/campaign_spec.h"

namespace etude {

using Rgb = std::array<double, 3>;  ///< red, green, blue

/// What the camera has to see, m in world: everything that objects and the hand around them may fill.
struct ViewedVolume {
  std::array<double, 2> x{-0.48, 0.48}, y{0.0, 0.48}, z{0.0, 0.32};
};

/// What is drawn for one episode beside its objects' places. The default changes nothing of the scene.
struct EpisodeWorld {
  std::optional<CameraSpec> camera;     ///< instead of the scene's
  Rgb light{1, 1, 1};                   ///< gain of all lights
  Rgb sun_shift{0, 0, 0};               ///< added to the sun's unit direction
  std::string table;                    ///< one of SceneSpec::tables; "" is the scene's own
  double table_scale = 1;               ///< the table's picture is so much larger
  Rgb table_colour{1, 1, 1};            ///< gain of the table's picture
  std::optional<Rgb> background;        ///< instead of the scene's
  std::map<std::string, Rgb> colour;    ///< gain of an object's colours, by the scene's name; none: 1
  std::map<std::string, double> gloss;  ///< added to an object's specular reflection and shininess; none: 0

  bool operator==(const EpisodeWorld&) const = default;
};

/// The camera that a spec describes. @pre its vectors have three numbers each
Camera ToCamera(const CameraSpec& spec);

/// Whether all of ViewedVolume lies inside the picture, with a little room around it.
bool SeesWorkVolume(const CameraSpec& camera);

/// Classes of generated objects that no sentence of a campaign can name: what distractors are of.
std::vector<std::string> PossibleDistractorClasses(const CampaignSpec& spec);

/// The distractors of episode `index`, as scenes call them (see IsDistractor): generated objects for training, no two
/// of one class, and in some episodes a ball in place of the first. Others every kEpisodesPerScene episodes, as the
/// objects.
std::vector<std::string> DrawDistractors(const CampaignSpec& spec, std::uint64_t index);

/// The camera of episode `index`, nothing where it does not move. Drawn until it sees the work volume; where that is
/// rare, nearer and nearer to the campaign's camera.
std::optional<CameraSpec> DrawCamera(const CampaignSpec& spec, std::uint64_t index);

/// Every camera that episodes 0 .. `count` - 1 have, the campaign's own alone where it does not move.
std::vector<Camera> CamerasOf(const CampaignSpec& spec, std::uint64_t count);

/// All of it, a pure function of its arguments.
/// @param objects  of the scene, as it calls them; each has colours of its own
EpisodeWorld DrawWorld(const CampaignSpec& spec, std::uint64_t index, const std::vector<std::string>& objects);

/// For Episode::details, without what Episode::cameras has: {"light", "sun_shift", "table", ...}.
OrderedJson ToJson(const EpisodeWorld& world);

}  // namespace etude
