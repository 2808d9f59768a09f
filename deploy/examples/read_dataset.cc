// SPDX-License-Identifier: Apache-2.0
// Goes through a dataset, also one that is still collected: what each episode says, and its last picture as a .ppm.
//   read_dataset DATASET [PICTURE.ppm]
#include <fmt/format.h>

#include "services/episode/action.h"
#include "services/store/dataset.h"

etude::Status WritePicture(const etude::store::EpisodeRecord& record, const etude::Path& path) {
  const auto& camera = record.episode.cameras.at(0).camera;
  // a block of frames is read and inflated at once: its other frames would cost nothing more
  etude::store::FrameReader frames(record.path, record.frames.at(0));
  ETUDE_ASSIGN_OR_RETURN(const auto rgb, frames.Read(record.frames[0].size() - 1));
  std::string file = fmt::format("P6 {} {} 255\n", camera.width, camera.height);
  file.append(rgb.begin(), rgb.end());
  return etude::WriteFileAtomically(path, file);
}

etude::Status Read(const etude::Path& dataset, const etude::Path& picture) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, etude::store::DatasetReader::Open(dataset));
  ETUDE_ASSIGN_OR_RETURN(const auto indices, reader.List());
  for (const std::uint64_t index : indices) {
    ETUDE_ASSIGN_OR_RETURN(const auto record, reader.Read(index));
    const etude::Episode& episode = record.episode;
    const auto hand = episode.eef_pos.row(episode.steps() - 1);
    fmt::print("{:6d}  {:<10} \"{}\"  {:.2f} s, {}, hand ends at ({:.3f}, {:.3f}, {:.3f}) m\n", index, episode.robot,
               episode.instruction, episode.steps() / etude::kControlRate, episode.outcome, hand[0], hand[1], hand[2]);
    if (!picture.empty() && !record.frames.empty() && !record.frames[0].empty())
      ETUDE_RETURN_IF_ERROR(WritePicture(record, picture));
  }
  return {};
}

int main(int argc, char** argv) {
  if (argc != 2 && argc != 3) return fmt::print(stderr, "usage: read_dataset DATASET [PICTURE.ppm]\n"), 2;
  const auto status = Read(argv[1], argc == 3 ? argv[2] : "");
  if (!status) return fmt::print(stderr, "{}\n", status.error().message), 1;
  return 0;
}
