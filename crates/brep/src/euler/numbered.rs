//! Slots of entities that are added and removed.

/// Entities by number. Numbers of removed entities are reused, the last one first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Numbered<T> {
    list: Vec<Option<T>>,
    free: Vec<u32>,
}

impl<T> Default for Numbered<T> {
    fn default() -> Numbered<T> {
        Numbered { list: Vec::new(), free: Vec::new() }
    }
}

impl<T> FromIterator<T> for Numbered<T> {
    fn from_iter<I: IntoIterator<Item = T>>(entities: I) -> Numbered<T> {
        Numbered { list: entities.into_iter().map(Some).collect(), free: Vec::new() }
    }
}

impl<T> Numbered<T> {
    pub(super) fn add(&mut self, entity: T) -> u32 {
        match self.free.pop() {
            Some(number) => {
                self.list[number as usize] = Some(entity);
                number
            }
            None => {
                self.list.push(Some(entity));
                self.list.len() as u32 - 1
            }
        }
    }

    pub(super) fn remove(&mut self, number: u32) {
        self.list[number as usize] = None;
        self.free.push(number);
    }

    pub(super) fn get(&self, number: u32) -> Option<&T> {
        self.list.get(number as usize)?.as_ref()
    }

    pub(super) fn get_mut(&mut self, number: u32) -> Option<&mut T> {
        self.list.get_mut(number as usize)?.as_mut()
    }

    pub(super) fn numbers(&self) -> impl Iterator<Item = u32> {
        (0..).zip(&self.list).filter(|(_, entity)| entity.is_some()).map(|(number, _)| number)
    }

    /// Returns the count of numbers in use or free.
    pub(super) fn slots(&self) -> usize {
        self.list.len()
    }

    pub(super) fn len(&self) -> u64 {
        (self.list.len() - self.free.len()) as u64
    }
}
