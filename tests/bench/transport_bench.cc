// SPDX-License-Identifier: Apache-2.0
// Episodes from one process to another on the path that workers and the collector take: a blob of an episode's size,
// sent, hashed at both ends (SHA-256), received whole, acknowledged by the application, then the next one. Against
// ddsperf (reliable; nothing verified, nothing acknowledged) with the same DDS profile and samples of one chunk.
// Both sides run in turn, A/B/A/B, each as processes of its own: first in clear, then both under the governance that
// `etude security init` ships, with identities of an authority that is made for it.
//
//   transport_bench [REPEATS [SECONDS]]
//
// A JSON line each; `to_plain` of the second is what security leaves of our own throughput.
#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "services/bus/access.h"
#include "services/bus/blob_transfer.h"
#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/security/authority.h"
#include "tests/bench/processes.h"
#include "tests/support/temporary_folder.h"

namespace {

using namespace etude;
using namespace etude::bench;
using namespace std::chrono_literals;

constexpr std::size_t kEpisodeSize = 2'200'000;  // of the campaign `quickstart`, on average
constexpr std::uint32_t kDomain = 70;
constexpr double kWarmUpS = 0.5;

constexpr char kProfile[] = "deploy/dds/local.xml";

template <class T>
T OrDie(Result<T> result) {
  if (!result) {
    std::fprintf(stderr, "%s\n", result.error().message.c_str());
    std::exit(3);
  }
  return std::move(*result);
}

// @param identity  its folder; "": in clear
bus::Participant OpenOrDie(const std::string& identity) {
  InitLog("bench", "warn");  // to stderr: stdout is for results
  return OrDie(bus::Participant::Open({kDomain, "", identity}));
}

// Sends episodes one after the other, as a worker does, until it is killed or stopped.
int RunSender(const std::string& identity) {
  InstallStopSignals();
  const auto participant = OpenOrDie(identity);
  auto sender = bus::BlobSender::Open(participant, {"bench", "1"}, "episode", bus::UniquePeerName());
  if (!sender) return 1;
  std::vector<std::uint8_t> episode(kEpisodeSize);
  for (std::size_t i = 0; i < kEpisodeSize; ++i) episode[i] = static_cast<std::uint8_t>(i * 31 + i / 255);
  for (std::uint64_t id = 1; !StopRequested(); ++id) {
    episode[id % kEpisodeSize] ^= 1;
    if (!sender->Send(id, episode, id, "", 30s) && !StopRequested()) return 1;
  }
  return 0;
}

// Prints verified episodes a second, and all of them.
int RunReceiver(double seconds, const std::string& identity) {
  const auto participant = OpenOrDie(identity);
  auto receiver = bus::BlobReceiver::Open(participant, {"bench", "1"}, "episode");
  if (!receiver) return 1;
  std::uint64_t total = 0, episodes = 0;
  Stopwatch watch;
  bool warm = false;
  for (auto episode = receiver->Receive(30s); !warm || watch.Seconds() < seconds; episode = receiver->Receive(5s)) {
    if (!episode) return 2;
    if (episode->bytes.size() != kEpisodeSize) return 3;
    if (!receiver->Acknowledge(episode->manifest, {})) return 1;
    if (!warm && watch.Seconds() > kWarmUpS) {
      warm = true;
      episodes = 0;
      watch.Restart();
      continue;
    }
    ++episodes;
    ++total;
  }
  std::printf("%.3f %" PRIu64 "\n", static_cast<double>(episodes) / watch.Seconds(), total);
  return receiver->corrupt_blobs() == 0 ? 0 : 4;
}

struct Sides {
  std::vector<double> megabytes;  // a second, of each round
  std::vector<double> cpu_ms;     // CPU time of all processes for a megabyte
};

// Who is who on a secured bus, and nobody on one in clear.
struct Identities {
  std::string worker, collector;  // folders
  std::string ddsperf_profile;    // file
};

// The identity of ddsperf as its profile says it: it knows no other way.
std::string WithSecurity(std::string profile, const Path& identity) {
  const auto library = [](const char* path, const char* function) {
    return std::string("<Library path=\"") + path + "\" initFunction=\"init_" + function +
           "\" finalizeFunction=\"finalize_" + function + "\"/>";
  };
  const auto file = [&](const char* element, const char* name) {
    return std::string("<") + element + ">file:" + (identity / name).string() + "</" + element + ">";
  };
  const std::string security = "<Security><Authentication>" + library("dds_security_auth", "authentication") +
                               file("IdentityCA", "identity-ca.pem") + file("IdentityCertificate", "cert.pem") +
                               file("PrivateKey", "key.pem") + "</Authentication><AccessControl>" +
                               library("dds_security_ac", "access_control") +
                               file("PermissionsCA", "permissions-ca.pem") + file("Governance", "governance.p7s") +
                               file("Permissions", "permissions.p7s") + "</AccessControl><Cryptographic>" +
                               library("dds_security_crypto", "crypto") + "</Cryptographic></Security>";
  return profile.insert(profile.rfind("</Domain>"), security);
}

Identities MakeIdentities(const Path& authority) {
  using security::Grant;
  using security::Role;
  if (const Status made = security::InitAuthority(authority, security::Protection::kEncrypt); !made)
    OrDie<int>(Fail(made.error()));
  const auto now = static_cast<std::int64_t>(WallSeconds());
  const auto issue = [&](const char* name, Role role, std::vector<Grant> grants) {
    return OrDie(security::Issue(authority, {.name = name,
                                             .roles = {role},
                                             .grants = std::move(grants),
                                             .not_before = now - 60,
                                             .not_after = now + 86'400}));
  };
  Identities identities;
  identities.worker = issue("sender", Role::kWorker, bus::GrantsFor({Role::kWorker}, "sender", {"bench"}, {})).string();
  identities.collector =
      issue("receiver", Role::kCollector, bus::GrantsFor({Role::kCollector}, "receiver", {"bench"}, {})).string();
  // its topics are none of ours
  const Path ddsperf = issue("ddsperf", Role::kRobot, {{true, "*", "*"}, {false, "*", "*"}});
  const std::string profile = WithSecurity(OrDie(ReadTextFile(kProfile)), ddsperf);
  identities.ddsperf_profile = (authority / "ddsperf.xml").string();
  if (const Status written = WriteFileAtomically(identities.ddsperf_profile, std::string_view(profile)); !written)
    OrDie<int>(Fail(written.error()));
  return identities;
}

void RunOurs(double seconds, int senders, const Identities& identities, Sides& sides) {
  const double cpu_before = ChildrenCpuSeconds();
  double rate = 0;
  std::uint64_t total = 0;
  {
    std::vector<std::unique_ptr<Child>> sending;
    for (int i = 0; i < senders; ++i) sending.push_back(std::make_unique<Child>(Self({"sender", identities.worker})));
    Child receiver(Self({"receiver", std::to_string(seconds), identities.collector}));
    std::sscanf(receiver.ReadAll().c_str(), "%lf %" SCNu64, &rate, &total);
  }
  const double megabytes = static_cast<double>((total + 1) * kEpisodeSize) / 1e6;
  sides.megabytes.push_back(rate * kEpisodeSize / 1e6);
  sides.cpu_ms.push_back(1e3 * (ChildrenCpuSeconds() - cpu_before) / megabytes);
}

void RunDdsperf(double seconds, const Identities& identities, Sides& sides) {
  const std::size_t chunk = bus::SendOptions{}.chunk_size;
  const double cpu_before = ChildrenCpuSeconds();
  if (!identities.ddsperf_profile.empty()) UseProfile(identities.ddsperf_profile);
  const auto rates = DdsperfRates(kDomain, chunk + 12, seconds);
  UseProfile(kProfile);
  double total = 1;
  for (const double rate : rates) total += rate;
  total *= static_cast<double>(rates.size() + 1) / static_cast<double>(std::max<std::size_t>(rates.size(), 1));
  sides.megabytes.push_back(Median(rates) * static_cast<double>(chunk) / 1e6);
  sides.cpu_ms.push_back(1e3 * (ChildrenCpuSeconds() - cpu_before) / (total * static_cast<double>(chunk) / 1e6));
}

// SHA-256 of an episode on one core, MB/s: at both ends of a transfer it bounds what can be reached.
double HashMegabytes() {
  const std::vector<std::uint8_t> episode(kEpisodeSize, 7);
  std::uint64_t sink = 0;
  std::size_t count = 0;
  const Stopwatch watch;
  for (; watch.Seconds() < 0.5; ++count) sink += Sha256Of(episode)[0];
  return (sink > 0 ? 1.0 : 0.5) * static_cast<double>(count * kEpisodeSize) / 1e6 / watch.Seconds();
}

struct Outcome {
  double ours = 0, theirs = 0;  // MB/s
};

Outcome Measure(const char* how, int repeats, double seconds, const Identities& identities) {
  Sides one, two, theirs;
  for (int i = 0; i < repeats; ++i) {
    RunDdsperf(seconds, identities, theirs);
    RunOurs(seconds, 1, identities, one);
    RunOurs(seconds, 2, identities, two);
    std::fprintf(stderr, "%s, round %d: ddsperf %.0f MB/s, ours %.0f (one worker), %.0f (two)\n", how, i + 1,
                 theirs.megabytes.back(), one.megabytes.back(), two.megabytes.back());
  }
  for (const auto& [name, side] :
       {std::pair{"ddsperf", &theirs}, {"ours, one worker", &one}, {"ours, two workers", &two}}) {
    std::fprintf(stderr, "%s, %-18s %s MB/s, CPU %s ms/MB\n", how, name, Summary(side->megabytes).c_str(),
                 Summary(side->cpu_ms).c_str());
  }
  return {Median(one.megabytes), Median(theirs.megabytes)};
}

double Ratio(double value, double baseline) { return baseline > 0 ? value / baseline : 0; }

int RunBench(int repeats, double seconds) {
  UseProfile(kProfile);
  const TemporaryFolder folder;
  const double calibration_before = TwoProcessSpin();
  const Outcome plain = Measure("in clear", repeats, seconds, {});
  const Outcome secured = Measure("secured", repeats, seconds, MakeIdentities(folder / "authority"));
  const double calibration_after = TwoProcessSpin();
  std::fprintf(stderr, "one core alone: SHA-256 %.0f MB/s, needed at both ends\n", HashMegabytes());
  std::fprintf(stderr, "secured over in clear: ddsperf %.2f, ours %.2f\n", Ratio(secured.theirs, plain.theirs),
               Ratio(secured.ours, plain.ours));
  PrintCalibration(calibration_before, calibration_after);
  std::printf("{\"name\": \"transport\", \"value\": %.1f, \"unit\": \"MB/s\", \"baseline\": %.1f, \"ratio\": %.3f}\n",
              plain.ours, plain.theirs, Ratio(plain.ours, plain.theirs));
  std::printf(
      "{\"name\": \"transport_secured\", \"value\": %.1f, \"unit\": \"MB/s\", \"baseline\": %.1f, \"ratio\": %.3f, "
      "\"to_plain\": %.3f, \"ddsperf_to_plain\": %.3f}\n",
      secured.ours, secured.theirs, Ratio(secured.ours, secured.theirs), Ratio(secured.ours, plain.ours),
      Ratio(secured.theirs, plain.theirs));
  return std::min({plain.ours, plain.theirs, secured.ours, secured.theirs}) > 0 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 3 && std::strcmp(argv[1], "sender") == 0) return RunSender(argv[2]);
  if (argc == 4 && std::strcmp(argv[1], "receiver") == 0) return RunReceiver(std::strtod(argv[2], nullptr), argv[3]);
  const int repeats = argc > 1 ? std::atoi(argv[1]) : 5;
  const double seconds = argc > 2 ? std::strtod(argv[2], nullptr) : 3;
  return RunBench(std::max(1, repeats), seconds);
}
