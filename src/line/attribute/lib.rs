//! `#[keys]` declares the keys of a section of a scene line, and of the recipe's section with the same name.
//!
//! ```text
//! /// Waves that all faces share.
//! #[keys(recipe = WaveRecipe)]
//! pub struct Wave {
//!     /// Height of the crests; 0 is flat.
//!     #[key("[0, 1e4] m")]
//!     pub amplitude_m: f64,
//!     /// Direction across the crests, from right to down.
//!     #[key("[-360, 360] degrees", default = 0.0)]
//!     pub direction_deg: f64,
//! }
//! ```
//!
//! makes `Wave` with its reader and writer, `WaveRecipe`, in which each number may be a distribution, and what checks, draws and
//! describes both (`Keys`, `Drawn`). A field has a doc comment, which is the text of the key in tables and schemas, and:
//!
//! | in `#[key(..)]` | |
//! |---|---|
//! | `"(0, 1] m"` | allowed values of a number, with their unit; several, separated by `;`, for the elements of an array |
//! | `default = value` | the key may be missing in lines and recipes; a line does not write it then |
//! | `recipe = value` | default of a recipe alone, or in place of `default`; may be a distribution |
//! | `shown = "words"` | the default for readers, if its expression does not say it |
//! | `written` | a line writes the key even if it has its default |
//! | `decides` | the value decides whether pane, lens and film fit together: refused scenes draw it again |
//! | `line_only`, `recipe_only` | the key of a line or of a recipe alone |
//!
//! `Option` and `Vec` may be missing without a default. An enum of variants with named fields is a section with one of several forms.

mod field;
mod range;

use field::Field;
use proc_macro2::TokenStream;
use quote::{format_ident, quote};
use syn::parse::{Parse, ParseStream};
use syn::{Attribute, Fields, Ident, Item, Token, Visibility, parse_macro_input};

/// The arguments of `#[keys(..)]`.
struct Arguments {
    recipe: Option<Ident>,
}

impl Parse for Arguments {
    fn parse(input: ParseStream<'_>) -> syn::Result<Self> {
        if input.is_empty() {
            return Ok(Self { recipe: None });
        }
        let name: Ident = input.parse()?;
        if name != "recipe" {
            return Err(syn::Error::new(name.span(), "expected `recipe = NameOfTheType`"));
        }
        input.parse::<Token![=]>()?;
        Ok(Self { recipe: Some(input.parse()?) })
    }
}

/// Declares the keys of a section: see the documentation of the crate.
#[proc_macro_attribute]
pub fn keys(
    arguments: proc_macro::TokenStream,
    item: proc_macro::TokenStream,
) -> proc_macro::TokenStream {
    let Arguments { recipe } = parse_macro_input!(arguments as Arguments);
    let item = parse_macro_input!(item as Item);
    let declared = Section::read(item).map(|section| {
        let (line, keys) = (section.line(), section.keys());
        let recipe = recipe.map(|recipe| section.recipe(&recipe));
        quote!(#line #keys #recipe)
    });
    declared.unwrap_or_else(|error| error.to_compile_error()).into()
}

/// A section: a struct, or an enum of several forms.
struct Section {
    name: Ident,
    attributes: Vec<Attribute>,
    visibility: Visibility,
    is_enum: bool,
    forms: Vec<Form>,
}

/// A form of a section. A struct has one, without a name.
struct Form {
    name: Option<Ident>,
    docs: Vec<Attribute>,
    fields: Vec<Field>,
}

impl Form {
    fn read(name: Option<Ident>, docs: Vec<Attribute>, fields: Fields) -> syn::Result<Self> {
        let fields = match fields {
            Fields::Named(fields) => fields.named,
            Fields::Unit => syn::punctuated::Punctuated::new(),
            Fields::Unnamed(fields) => {
                return Err(syn::Error::new_spanned(fields, "keys need names"));
            }
        };
        let read = |field| Field::read(field, name.as_ref());
        let fields = fields.into_iter().map(read).collect::<Result<_, _>>()?;
        Ok(Self { name, docs, fields })
    }

    /// Returns the form's path behind the type's name, as `::Form` or nothing.
    fn path(&self) -> TokenStream {
        self.name.as_ref().map(|name| quote!(::#name)).unwrap_or_default()
    }

    /// Returns the name of the form as files have it.
    fn shown(&self) -> String {
        self.name.as_ref().map_or_else(String::new, |name| field::snake(&name.to_string()))
    }

    /// Returns the fields in braces behind the form's name; none for a form without keys.
    fn declared(&self, fields: &[TokenStream]) -> TokenStream {
        let (docs, name) = (&self.docs, &self.name);
        if fields.is_empty() && name.is_some() {
            return quote!(#(#docs)* #name);
        }
        quote!(#(#docs)* #name { #(#fields,)* })
    }
}

impl Section {
    fn read(item: Item) -> syn::Result<Self> {
        match item {
            Item::Struct(item) => {
                let forms = vec![Form::read(None, vec![], item.fields)?];
                let (name, attributes, visibility) = (item.ident, item.attrs, item.vis);
                Ok(Self { name, attributes, visibility, is_enum: false, forms })
            }
            Item::Enum(item) => {
                let form = |variant: syn::Variant| {
                    Form::read(Some(variant.ident), variant.attrs, variant.fields)
                };
                let forms = item.variants.into_iter().map(form).collect::<Result<_, _>>()?;
                let (name, attributes, visibility) = (item.ident, item.attrs, item.vis);
                Ok(Self { name, attributes, visibility, is_enum: true, forms })
            }
            other => Err(syn::Error::new_spanned(other, "a section is a struct or an enum")),
        }
    }

    /// Returns a type with these forms, and its reader.
    fn declare(
        &self,
        name: &Ident,
        attributes: &[&Attribute],
        forms: &[TokenStream],
    ) -> TokenStream {
        let visibility = &self.visibility;
        let body = if self.is_enum {
            quote!(enum #name { #(#forms,)* })
        } else {
            quote!(struct #name #(#forms)*)
        };
        quote! {
            #[derive(Clone, Debug, PartialEq, ::serde::Serialize, ::serde::Deserialize, ::schemars::JsonSchema)]
            #(#attributes)*
            #[serde(deny_unknown_fields)]
            #visibility #body
        }
    }

    /// Returns the section of a line.
    fn line(&self) -> TokenStream {
        let name = &self.name;
        let form = |form: &Form| {
            let fields = form.fields.iter().filter(|field| !field.recipe_only);
            form.declared(&fields.map(|field| field.of_line(name)).collect::<Vec<_>>())
        };
        let forms: Vec<TokenStream> = self.forms.iter().map(form).collect();
        let line = self.declare(name, &self.attributes.iter().collect::<Vec<_>>(), &forms);
        let fields = self.forms.iter().flat_map(|form| &form.fields);
        let defaults = fields.filter(|field| !field.recipe_only).map(Field::line_functions);
        quote! {
            #line

            impl #name { #(#defaults)* }
        }
    }

    /// Returns the name of the type that holds the declared keys.
    fn declared_keys(&self) -> Ident {
        format_ident!("{}Keys", self.name)
    }

    /// Returns the place of a form's keys: in a table with its name, if the section is an enum with tags.
    fn place(&self, form: &Form) -> Option<TokenStream> {
        let has_word = |attribute: &&Attribute| {
            attribute.path().is_ident("serde")
                && quote!(#attribute).to_string().contains("untagged")
        };
        let is_tagged = self.is_enum && !self.attributes.iter().any(|a| has_word(&a));
        let name = form.shown();
        (is_tagged && !form.fields.is_empty()).then(|| quote!(let at = &at.form(#name);))
    }

    /// Returns the declared keys, and the implementation of `Keys`.
    fn keys(&self) -> TokenStream {
        let (name, declared) = (&self.name, self.declared_keys());
        let all: Vec<&Field> = self.forms.iter().flat_map(|form| &form.fields).collect();
        let descriptions = all.iter().map(|field| field.description());
        let rows = self.forms.iter().map(|form| {
            let at = self.place(form);
            let rows = form.fields.iter().map(|field| {
                let (ty, key) = (&field.ty, field.key());
                quote!(<#ty as crate::keys::Keys>::rows(&at.key(&#declared::#key), rows);)
            });
            quote!({ #at #(#rows)* })
        });
        let arms = self.forms.iter().map(|form| {
            let of_line = || form.fields.iter().filter(|field| !field.recipe_only);
            let (path, names) = (form.path(), of_line().map(|field| &field.name));
            let visits = of_line().map(|field| {
                let (name, key) = (&field.name, field.key());
                quote!(crate::keys::Keys::numbers(#name, &at.key(&#declared::#key), visit);)
            });
            let at = self.place(form);
            quote!(Self #path { #(#names),* } => { #at #(#visits)* })
        });
        quote! {
            /// The declared keys.
            struct #declared;

            impl #declared { #(#descriptions)* }

            impl crate::keys::Keys for #name {
                fn rows(at: &crate::keys::At<'static>, rows: &mut ::std::vec::Vec<crate::keys::Row>) {
                    #(#rows)*
                }

                fn numbers(&self, at: &crate::keys::At<'_>, visit: &mut crate::keys::Visit<'_>) {
                    match self { #(#arms)* }
                }
            }
        }
    }

    /// Returns the section of a recipe, and how scenes draw that of a line from it.
    fn recipe(&self, recipe: &Ident) -> TokenStream {
        let (line, declared) = (&self.name, self.declared_keys());
        let form = |form: &Form| {
            let fields = form.fields.iter().filter(|field| !field.line_only);
            form.declared(&fields.map(|field| field.of_recipe(recipe)).collect::<Vec<_>>())
        };
        let forms: Vec<TokenStream> = self.forms.iter().map(form).collect();
        let kept = |attribute: &&Attribute| {
            attribute.path().is_ident("doc") || attribute.path().is_ident("serde")
        };
        let attributes: Vec<&Attribute> = self.attributes.iter().filter(kept).collect();
        let section = self.declare(recipe, &attributes, &forms);
        let all = self.forms.iter().flat_map(|form| &form.fields);
        let defaults = all.filter(|field| !field.line_only).map(Field::recipe_default);
        let params = self.forms.iter().map(|form| {
            let of_recipe = || form.fields.iter().filter(|field| !field.line_only);
            let (path, names) = (form.path(), of_recipe().map(|field| &field.name));
            let visits = of_recipe().map(|field| {
                let (name, ty, key) = (&field.name, &field.ty, field.key());
                quote!(<#ty as crate::keys::Drawn>::params(#name, &at.key(&#declared::#key), visit);)
            });
            let at = self.place(form);
            quote!(#recipe #path { #(#names),* } => { #at #(#visits)* })
        });
        let draws = self.forms.iter().map(|form| {
            let (path, of_recipe) = (form.path(), form.fields.iter().filter(|f| !f.line_only));
            let names = of_recipe.filter(|field| !field.recipe_only).map(|field| &field.name);
            let values = form.fields.iter().filter(|field| !field.recipe_only).map(|field| {
                let (name, key) = (&field.name, field.key());
                if field.line_only {
                    let value = field.missing();
                    quote!(#name: #value)
                } else {
                    quote!(#name: crate::keys::Drawn::draw(#name, &at.key(&#declared::#key), draw))
                }
            });
            let at = self.place(form);
            quote!(#recipe #path { #(#names,)* .. } => { #at Self #path { #(#values,)* } })
        });
        let default = self.default_of(recipe);
        quote! {
            #section

            impl #recipe { #(#defaults)* }

            #default

            impl crate::keys::Drawn for #line {
                type Recipe = #recipe;

                fn params<'r>(
                    recipe: &'r #recipe,
                    at: &crate::keys::At<'_>,
                    visit: &mut crate::keys::VisitParams<'_, 'r>,
                ) {
                    match recipe { #(#params)* }
                }

                fn draw(
                    recipe: &#recipe,
                    at: &crate::keys::At<'_>,
                    draw: &dyn crate::keys::Drawing,
                ) -> Self {
                    match recipe { #(#draws,)* }
                }
            }
        }
    }

    /// Returns the default of a recipe's section in which every key may be missing.
    fn default_of(&self, recipe: &Ident) -> Option<TokenStream> {
        let [Form { name: None, fields, .. }] = self.forms.as_slice() else {
            return None;
        };
        let of_recipe: Vec<&Field> = fields.iter().filter(|field| !field.line_only).collect();
        let has_all = of_recipe.iter().all(|field| field.may_be_missing_in_recipes());
        has_all.then(|| {
            let defaults = of_recipe.iter().map(|field| {
                let (name, value) = (&field.name, field.recipe_default_value());
                quote!(#name: #value)
            });
            quote! {
                impl ::std::default::Default for #recipe {
                    fn default() -> Self {
                        Self { #(#defaults,)* }
                    }
                }
            }
        })
    }
}
