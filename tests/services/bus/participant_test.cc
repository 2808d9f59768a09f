// SPDX-License-Identifier: Apache-2.0
#include "services/bus/participant.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <set>

#include "services/bus/topic.h"
#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace participant_test {

using namespace std::chrono_literals;

TEST(ParticipantOpen, BuiltInProfileWorksWithoutAnyFile) {
  ASSERT_EQ(::unsetenv("CYCLONEDDS_URI"), 0);
  auto participant = Participant::Open({106, ""});
  ASSERT_TRUE(participant) << participant.error().message;
  EXPECT_EQ(participant->domain(), 106u);
}

TEST(ParticipantOpen, ShippedProfilesAreAccepted) {
  for (const char* profile : {"deploy/dds/local.xml", "deploy/dds/lan.xml", "deploy/dds/cloud.xml"}) {
    auto participant = Participant::Open({106, profile});
    EXPECT_TRUE(participant) << profile << ": " << participant.error().message;
  }
}

TEST(ParticipantOpen, SeveralInAProcessShareTheDomain) {
  auto first = Participant::Open({106, ""});
  auto second = Participant::Open({106, ""});
  ASSERT_TRUE(first && second);
  auto writer = Writer<WorkRequest>::Open(*first, "p");
  auto reader = Reader<WorkRequest>::Open(*second, "p");
  ASSERT_TRUE(writer && reader);
  ASSERT_TRUE(writer->WaitForReaders(1, 10s));
  ASSERT_TRUE(writer->Write({"c", "w", 5, "v"}));
  ASSERT_TRUE(reader->Wait(10s));
  EXPECT_EQ(reader->Take().at(0).request_id, 5u);
}

TEST(ParticipantOpen, EntitiesOutliveTheParticipantObject) {
  std::optional<Reader<WorkRequest>> reader;
  {
    auto participant = Participant::Open({106, ""});
    ASSERT_TRUE(participant);
    auto opened = Reader<WorkRequest>::Open(*participant, "p");
    ASSERT_TRUE(opened);
    reader.emplace(std::move(*opened));
  }
  EXPECT_TRUE(reader->Take().empty());
}

TEST(ParticipantOpen, SaysWhatIsWrong) {
  auto bad_domain = Participant::Open({231, ""});
  ASSERT_FALSE(bad_domain);
  EXPECT_EQ(bad_domain.error().code, Code::kInvalidArgument);

  auto no_file = Participant::Open({106, "/no/such/profile.xml"});
  ASSERT_FALSE(no_file);
  EXPECT_EQ(no_file.error().code, Code::kUnavailable);
  EXPECT_NE(no_file.error().message.find("/no/such/profile.xml"), std::string::npos);

  auto bad_xml = Participant::Open({106, "<CycloneDDS><Domain><Generall/></Domain></CycloneDDS>"});
  ASSERT_FALSE(bad_xml);
  EXPECT_EQ(bad_xml.error().code, Code::kUnavailable);
  EXPECT_NE(bad_xml.error().message.find("Generall"), std::string::npos) << bad_xml.error().message;

  auto no_interface =
      Participant::Open({106,
                         "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='nosuch0'/></Interfaces>"
                         "</General></Domain></CycloneDDS>"});
  ASSERT_FALSE(no_interface);
  EXPECT_EQ(no_interface.error().code, Code::kUnavailable);
  EXPECT_NE(no_interface.error().message.find("nosuch0"), std::string::npos) << no_interface.error().message;
  EXPECT_NE(no_interface.error().message.find("deploy/dds"), std::string::npos);
}

TEST(ParticipantOpen, SaysThatNoIndexIsFree) {
  const std::string profile = LocalProfileWith("<ExternalDomainId>106</ExternalDomainId>");
  std::string small = profile;
  const std::string many = "<MaxAutoParticipantIndex>119";
  small.replace(small.find(many), many.size(), "<MaxAutoParticipantIndex>1");
  auto first = Participant::Open({160, small});
  ASSERT_TRUE(first) << first.error().message;
  auto second = Participant::Open({161, small});
  auto third = Participant::Open({162, small});
  ASSERT_FALSE(second && third);  // whether one or two fit is the library's affair
  const Error& error = third ? second.error() : third.error();
  EXPECT_EQ(error.code, Code::kUnavailable);
  EXPECT_NE(error.message.find("MaxAutoParticipantIndex"), std::string::npos) << error.message;
  EXPECT_NE(error.message.find("--processes"), std::string::npos) << error.message;
}

TEST(ParticipantOpen, RefusesASecondProfileForOneDomain) {
  auto first = Participant::Open({106, "deploy/dds/local.xml"});
  ASSERT_TRUE(first);
  auto second = Participant::Open({106, "deploy/dds/lan.xml"});
  ASSERT_FALSE(second);
  EXPECT_NE(second.error().message.find("another profile"), std::string::npos);
}

TEST(PeerName, IsUnique) {
  std::set<std::string> names;
  for (int i = 0; i < 8; ++i) names.insert(UniquePeerName());
  EXPECT_GE(names.size(), 7u);
  EXPECT_NE(names.begin()->find(std::to_string(::getpid())), std::string::npos);
}

}  // namespace participant_test
}  // namespace etude::bus
