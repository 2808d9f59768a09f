// SPDX-License-Identifier: Apache-2.0
// Takes the checkpoints that a run publishes, each verified by its hash, and says what is in them.
//   subscribe RUN DOMAIN COUNT [PUBLIC_KEY [IDENTITY]]
// With a public key (etude security signing-key) only checkpoints that the trainer signed are taken, and none older
// than one that was taken before. IDENTITY is a folder of `etude security issue`, for a secured bus.
#include <fmt/format.h>

#include "services/bus/blob_transfer.h"
#include "services/bus/directory.h"
#include "services/core/stop.h"
#include "services/security/checkpoint_signature.h"
#include "services/store/safetensors.h"

using namespace std::chrono_literals;

etude::Status Subscribe(const std::string& name, std::uint32_t domain, int count, const std::string& key,
                        const std::string& identity) {
  ETUDE_ASSIGN_OR_RETURN(auto verifier, etude::security::VerifyArguments{key}.Open());
  ETUDE_ASSIGN_OR_RETURN(const auto participant,
                         etude::bus::Participant::Open({domain, "", identity, {etude::security::Role::kSubscriber}}));
  // a run is found by its name; its id, which is unique, says where it publishes
  ETUDE_ASSIGN_OR_RETURN(const auto selector, etude::ParseSelector(name, "RUN"));
  ETUDE_ASSIGN_OR_RETURN(auto directory, etude::bus::Directory::Open(participant));
  auto run = directory.FindPublisher(selector, 1s);
  if (run && !*run) fmt::print(stderr, "waiting for run '{}' on domain {}\n", name, domain);
  while (run && !*run && !etude::StopRequested()) run = directory.FindPublisher(selector, 1s);
  if (!run) return etude::Fail(run.error());
  if (!*run) return {};
  const etude::bus::Owner owner{(*run)->name, (*run)->id};  // checkpoints of another run are not taken
  ETUDE_ASSIGN_OR_RETURN(
      auto subscriber,
      etude::bus::BlobSubscriber::Open(participant, owner, "latest", {.accept = etude::bus::AcceptSigned(verifier)}));
  for (int taken = 0; taken < count && !etude::StopRequested();) {
    const auto blob = subscriber.Wait(1s);
    if (!blob) continue;
    ETUDE_ASSIGN_OR_RETURN(const auto checkpoint, etude::store::DecodeSafetensors(blob->bytes));
    fmt::print("version {}: {} bytes, {} tensors, sha256 {}\n", blob->version, blob->bytes.size(),
               checkpoint.tensors.size(), blob->sha256);
    ++taken;
  }
  return {};
}

int main(int argc, char** argv) try {
  if (argc < 4 || argc > 6) return fmt::print(stderr, "usage: subscribe RUN DOMAIN COUNT [PUBLIC_KEY [IDENTITY]]\n"), 2;
  etude::InstallStopSignals();
  const auto status = Subscribe(argv[1], static_cast<std::uint32_t>(std::stoul(argv[2])), std::stoi(argv[3]),
                                argc > 4 ? argv[4] : "", argc > 5 ? argv[5] : "");
  if (!status) return fmt::print(stderr, "{}\n", status.error().message), 3;
  return 0;
} catch (const std::exception& error) {  // DOMAIN or a count is no number
  return fmt::print(stderr, "subscribe: a number was expected ({})\n", error.what()), 2;
}
