//! Copies of all chunks of a file.

use super::chunks::ChunkList;
use super::reader::ExactModel;
use super::summary::Summary;
use super::writer::{List, ModelWriter};
use spinney_base::{Progress, Result};

impl ExactModel {
    pub(crate) fn summary(&self) -> &Summary {
        &self.summary
    }

    /// Copies all chunks of the exact surface to a file, without levels of detail.
    pub(crate) fn copy_chunks(&self, writer: &mut ModelWriter, progress: &dyn Progress) -> Result<()> {
        let lists: [(List, &ChunkList); 5] = [
            (List::Faces, &self.blocks),
            (List::Exact, &self.exact),
            (List::Segments, &self.segments),
            (List::Objects, &self.objects),
            (List::FaceValues, &self.face_values),
        ];
        for (kind, list) in lists {
            for index in 0..list.len() {
                progress.check()?;
                let key = list.entry(&self.path, &*self.backend, index)?.key;
                match writer.codec() == self.codec() {
                    true => {
                        writer.stored_chunk(kind, key, &list.stored(&self.path, &*self.backend, index)?)?;
                    }
                    false => writer.chunk(kind, key, &list.load(&self.path, &*self.backend, index)?)?,
                }
            }
        }
        Ok(())
    }
}
