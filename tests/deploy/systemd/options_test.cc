// SPDX-License-Identifier: Apache-2.0
// The options that settings, manifests and scripts in deploy/ give to programs are options that these have.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "tests/support/etude_command.h"
#include "tests/support/run_command.h"

namespace etude {
namespace options_test {

using Options = std::map<std::string, std::set<std::string>>;  // by program

const std::set<std::string> kServices{"etude-collector", "etude-worker", "etude-trainer", "etude-policy",
                                      "etude-gateway"};

// What a line is made of, without the brackets, commas and quotes of YAML and of the shell.
std::vector<std::string> WordsOf(std::string line) {
  for (char& c : line)
    if (std::string_view("[],\"'").find(c) != std::string_view::npos) c = ' ';
  std::istringstream stream(line);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

// Every word that begins with "--" belongs to the program before it, up to the next key of a manifest.
Options OptionsIn(const Path& file) {
  Options options;
  std::istringstream text(ReadTextFile(file).value_or(""));
  std::string program;
  for (std::string line; std::getline(text, line);) {
    const auto words = WordsOf(line);
    if (words.empty() || words[0].starts_with("#")) continue;
    if (words[0] == "env:" || words[0] == "srun" || words[0] == "---") program.clear();
    for (std::size_t i = 0; i < words.size(); ++i) {
      const bool net = i > 1 && words[i - 2] == "etude" && words[i - 1] == "doctor" && words[i] == "net";
      if (kServices.contains(words[i])) program = words[i];
      if (net) program = "etude doctor net";
      if (words[i] == "&") program.clear();
      if (words[i].size() > 2 && words[i].starts_with("--") && !program.empty()) options[program].insert(words[i]);
    }
  }
  return options;
}

// ETUDE_WORKER=--slots 4: options of etude-worker; those of ETUDE_BUS are everybody's.
Options OptionsOfSettings() {
  Options options;
  std::istringstream text(ReadTextFile("deploy/systemd/etude.env.in").value_or(""));
  for (std::string line; std::getline(text, line);) {
    const auto equals = line.find('=');
    if (!line.starts_with("ETUDE_") || equals == std::string::npos) continue;
    std::string name = line.substr(6, equals - 6);
    for (char& c : name) c = static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
    for (const auto& word : WordsOf(line.substr(equals + 1))) {
      if (!word.starts_with("--")) continue;
      for (const auto& service : kServices)
        if (name == "bus" || service == "etude-" + name) options[service].insert(word);
    }
  }
  return options;
}

void ExpectThatTheyAre(const Options& options, const std::string& where) {
  static std::map<std::string, std::string> helps;  // by program: some take a second
  for (const auto& [program, names] : options) {
    std::string& help = helps[program];
    if (help.empty()) help = RunInShell((ProgramsFolder() / program).string() + " --help 2>&1").text;
    for (const auto& name : names)
      EXPECT_TRUE(help.find(name + " ") != std::string::npos || help.find(name + ",") != std::string::npos)
          << where << ": " << program << " has no option " << name;
  }
}

TEST(DeployOptions, OfTheServicesSettings) {
  const Options options = OptionsOfSettings();
  EXPECT_EQ(options.size(), kServices.size());
  EXPECT_TRUE(options.at("etude-policy").contains("--relay"));
  ExpectThatTheyAre(options, "etude.env.in");
}

TEST(DeployOptions, OfTheManifests) {
  Options found;
  for (const auto& entry : std::filesystem::directory_iterator("deploy/kubernetes")) {
    if (entry.path().extension() != ".yaml") continue;
    const Options options = OptionsIn(entry.path());
    ExpectThatTheyAre(options, entry.path().string());
    for (const auto& [program, names] : options) found[program].insert(names.begin(), names.end());
  }
  for (const auto& service : kServices) EXPECT_FALSE(found[service].empty()) << service;
  EXPECT_TRUE(found["etude doctor net"].contains("--write-profile"));
  EXPECT_TRUE(found["etude-trainer"].contains("--name")) << "of a command over several lines";
}

TEST(DeployOptions, OfTheBatchScript) {
  const Options options = OptionsIn("deploy/slurm/etude.sbatch");
  EXPECT_TRUE(options.contains("etude-collector"));
  EXPECT_TRUE(options.contains("etude-worker"));
  EXPECT_TRUE(options.contains("etude doctor net"));
  ExpectThatTheyAre(options, "etude.sbatch");
}

}  // namespace options_test
}  // namespace etude
