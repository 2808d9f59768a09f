// SPDX-License-Identifier: Apache-2.0
#include "services/bus/manifest_intake.h"

#include <utility>

#include "services/bus/assembly.h"
#include "services/bus/typed.h"

namespace etude::bus {
namespace {

bool ViewIsSound(const ManifestView& view) {
  return view.sha256.size() == 32 && ShapeIsSound(view.size, view.chunk_size, view.chunk_count) &&
         (view.data.empty() || view.data.size() == view.size) && view.meta_json.size() <= kMaxText;
}

}  // namespace

Result<std::unique_ptr<ManifestIntake>> ManifestIntake::Open(const Participant& participant,
                                                             const std::string& partition) {
  std::unique_ptr<ManifestIntake> intake(new ManifestIntake);
  ETUDE_ASSIGN_OR_RETURN(intake->guard_, CheckEntity(dds_create_guardcondition(participant.state()->participant.get()),
                                                     "make a guard condition"));
  ETUDE_ASSIGN_OR_RETURN(intake->reader_, OpenReaderOf<BlobManifest>(participant, partition));
  dds_listener_t* const listener = dds_create_listener(intake.get());
  dds_lset_data_available(listener, &ManifestIntake::OnData);
  const dds_return_t code = dds_set_listener(intake->reader_.get(), listener);
  dds_delete_listener(listener);
  if (code != DDS_RETCODE_OK) return Fail(DdsError(code, "listen for manifests"));
  intake->Drain();  // what came before the listener
  return intake;
}

void ManifestIntake::OnData(dds_entity_t, void* intake) { static_cast<ManifestIntake*>(intake)->Drain(); }

void ManifestIntake::Drain() {
  const auto add = [this](Serialized& sample) {
    TakenManifest item;
    item.is_sound = Parse(sample.bytes(), item.view) && ViewIsSound(item.view);
    item.sample = std::move(sample);
    const MutexLock lock(mutex_);
    taken_.push_back(std::move(item));
    if (taken_.size() == wake_after_) dds_set_guardcondition(guard_.get(), true);
  };
  while (TakeSerialized(reader_, 64, add) > 0) {
  }
}

void ManifestIntake::WakeAfter(std::size_t count) {
  const MutexLock lock(mutex_);
  if (count == wake_after_) return;
  wake_after_ = count;
  if (taken_.size() >= count) dds_set_guardcondition(guard_.get(), true);
}

std::deque<TakenManifest> ManifestIntake::Take() {
  const MutexLock lock(mutex_);
  if (!taken_.empty()) dds_set_guardcondition(guard_.get(), false);
  return std::exchange(taken_, {});
}

}  // namespace etude::bus
