#include "app/open.h"

#include "core/error.h"
#include "core/uri.h"
#include "hw/replay_source.h"

namespace binrig {

std::vector<Scheme> source_schemes() {
  return {{"replay:SET[#split/id][?rate=real|max&loop=0|1]", "a recording, frame by frame"}};
}

std::unique_ptr<FrameSource> open_source(const std::string& text) {
  const Uri uri = Uri::parse(text);
  if (uri.scheme == "replay") return open_replay(uri);
  std::string known;
  for (const Scheme& scheme : source_schemes()) known += "\n  " + scheme.pattern + "  " + scheme.meaning;
  throw Error("no source has the scheme '" + uri.scheme + ":'; known are" + known);
}

}  // namespace binrig
